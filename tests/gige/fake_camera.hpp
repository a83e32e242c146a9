#pragma once
// A camera of a few registers for the tests of the transport: it delivers the frames that a test hands it.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <vector>

#include "camera/transport.hpp"
#include "gige/bytes.hpp"

namespace atomcam::test {

class FakeCamera : public TransportCamera {
 public:
  // Registers of 4 bytes: 0x10000 value (at most 1000), 0x10004 read-only, 0x10008 slow to write, 0x1000c
  // locked, 0x10010 starts (1) and stops (0) the acquisition.
  static constexpr std::uint32_t plain = 0x10000, fixed = 0x10004, slow = 0x10008, locked = 0x1000c,
                                 acquisition = 0x10010, end = 0x10014;

  Identity identity() const override {
    const std::lock_guard lock(mutex_);
    return {"atomcam", "Fake 1", "0.1", "for tests", "F-1", user_name_};
  }
  void set_user_name(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    user_name_ = name;
  }
  RegisterStatus read(std::uint32_t address, std::span<std::uint8_t> bytes) override {
    const std::lock_guard lock(mutex_);
    if (address < plain || address + bytes.size() > end) return RegisterStatus::invalid_address;
    for (std::size_t at = 0; at < bytes.size(); at += 4)
      gige::store32(bytes.data() + at, values_[(address - plain + at) / 4]);
    return RegisterStatus::ok;
  }
  RegisterStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes) override {
    if (address < plain || address >= end) return RegisterStatus::invalid_address;
    if (bytes.size() != 4) return RegisterStatus::bad_alignment;
    const std::uint32_t value = gige::load32(bytes, 0);
    if (address == fixed) return RegisterStatus::write_protect;
    if (address == locked) return RegisterStatus::access_denied;
    if (address == plain && value > 1000) return RegisterStatus::invalid_parameter;
    if (address == slow) std::this_thread::sleep_for(write_time.load());
    if (address == acquisition) acquire(value != 0);
    ++writes;
    const std::lock_guard lock(mutex_);
    values_[(address - plain) / 4] = value;
    return RegisterStatus::ok;
  }
  std::string genicam_xml(std::span<const FeatureDeclaration> features) const override {
    std::string xml = "<fake>";
    for (const FeatureDeclaration& one : features) xml += one.name + "\n";
    return xml + "</fake>";
  }
  void attach(FrameSink* sink) override {
    const std::lock_guard lock(sink_mutex_);
    sink_ = sink;
  }
  void stop_acquisition() override {
    ++stops;
    acquire(false);
  }
  std::uint64_t timestamp_ns() const override {
    return static_cast<std::uint64_t>((std::chrono::steady_clock::now() - opened_.load()).count());
  }
  void reset_timestamp() override { opened_ = std::chrono::steady_clock::now(); }
  void fire_action(int signal) override {
    const std::lock_guard lock(mutex_);
    actions_.push_back(signal);
  }
  void report_lost(std::uint64_t frame_id) override {
    const std::lock_guard lock(mutex_);
    lost_.push_back(frame_id);
  }

  // For the tests.
  void acquire(bool on) {
    if (acquiring.exchange(on) == on) return;
    const std::lock_guard lock(sink_mutex_);
    if (sink_ == nullptr) return;
    if (on)
      sink_->acquisition_started();
    else
      sink_->acquisition_stopped();
  }
  /// A frame whose pixel bytes are a function of its id and their place.
  static std::shared_ptr<CameraFrame> frame(std::uint64_t id, std::uint32_t width, std::uint32_t height,
                                            std::size_t chunk_bytes = 0) {
    auto frame = std::make_shared<CameraFrame>();
    frame->id = id;
    frame->timestamp_ns = 1'000'000 * id;
    frame->pixel_format = 0x01100007;
    frame->width = width;
    frame->height = height;
    frame->image_bytes = std::size_t{2} * width * height;
    frame->chunks = chunk_bytes > 0;
    frame->payload.resize(frame->image_bytes + chunk_bytes);
    for (std::size_t i = 0; i < frame->payload.size(); ++i) frame->payload[i] = expected_byte(id, i);
    return frame;
  }
  static std::uint8_t expected_byte(std::uint64_t id, std::size_t at) {
    return static_cast<std::uint8_t>((at * 2654435761u >> 13) + id);
  }
  void deliver(std::shared_ptr<const CameraFrame> frame) {
    const std::lock_guard lock(sink_mutex_);
    if (sink_ != nullptr) sink_->deliver(std::move(frame));
  }
  void notify(const CameraEvent& event) {
    const std::lock_guard lock(sink_mutex_);
    if (sink_ != nullptr) sink_->notify(event);
  }
  std::vector<int> actions() const {
    const std::lock_guard lock(mutex_);
    return actions_;
  }
  std::vector<std::uint64_t> lost() const {
    const std::lock_guard lock(mutex_);
    return lost_;
  }

  std::atomic<int> stops = 0, writes = 0;
  std::atomic<bool> acquiring = false;
  std::atomic<std::chrono::milliseconds> write_time{std::chrono::milliseconds(100)};

 private:
  mutable std::mutex mutex_, sink_mutex_;
  FrameSink* sink_ = nullptr;
  std::string user_name_ = "fake";
  std::array<std::uint32_t, 5> values_{7, 42, 0, 0, 0};
  std::vector<int> actions_;
  std::vector<std::uint64_t> lost_;
  std::atomic<std::chrono::steady_clock::time_point> opened_{std::chrono::steady_clock::now()};
};

}  // namespace atomcam::test
