#pragma once
// The control side without sockets, fed with datagrams: a device of few but real registers behind it. Checks
// what must hold whatever comes in.

#include <array>
#include <cstdlib>
#include <map>
#include <utility>

#include "gige/control_handler.hpp"
#include "gige/message_channel.hpp"

namespace atomcam::test {

/// Registers of 4 bytes from 0x10000; everything else is refused.
class PlainCamera final : public TransportCamera {
 public:
  Identity identity() const override { return {"atomcam", "Fuzzed", "0.1", "", "Z-1", user_name_}; }
  void set_user_name(const std::string& name) override { user_name_ = name; }
  RegisterStatus read(std::uint32_t address, std::span<std::uint8_t> bytes) override {
    if (address < first_address || address - first_address + bytes.size() > 4 * values_.size())
      return RegisterStatus::invalid_address;
    for (std::size_t at = 0; at < bytes.size(); at += 4)
      gige::store32(bytes.data() + at, values_[(address - first_address + at) / 4]);
    return RegisterStatus::ok;
  }
  RegisterStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes) override {
    if (address < first_address || address - first_address >= 4 * values_.size())
      return RegisterStatus::invalid_address;
    if (bytes.size() != 4) return RegisterStatus::bad_alignment;
    values_[(address - first_address) / 4] = gige::load32(bytes, 0);
    return RegisterStatus::ok;
  }
  std::string genicam_xml(std::span<const FeatureDeclaration>) const override { return "<fuzzed/>"; }
  void attach(FrameSink*) override {}
  void stop_acquisition() override {}
  std::uint64_t timestamp_ns() const override { return 1; }
  void reset_timestamp() override {}
  void fire_action(int) override {}
  void report_lost(std::uint64_t) override {}

 private:
  std::string user_name_;
  std::array<std::uint32_t, 16> values_{};
};

class ControlTarget final : public gige::ControlActions {
 public:
  ControlTarget() : handler_(camera_, *this, facts()) {}

  /// One datagram. Two clients take turns by its last bit, time goes on by a part of a heartbeat at most.
  void feed(gige::Bytes datagram, std::uint32_t chance) {
    const gige::Endpoint from{0x7f000001, static_cast<std::uint16_t>(40000 + (chance & 1))};
    now_ += std::chrono::milliseconds(chance >> 1 & 0x3f);
    if ((chance >> 20) == 0) now_ += std::chrono::seconds(10);  // silence beyond the heartbeat
    gige::ControlHandler::Answers out;
    handler_.receive(datagram, from, now_, out);
    // At times the camera is slow, so that commands pile up.
    if (slow_left_ > 0)
      --slow_left_;
    else if ((chance >> 8 & 0xff) == 0)
      slow_left_ = 120;
    if (slow_left_ == 0)
      while (const auto write = handler_.take_camera_write())
        handler_.camera_wrote(camera_.write(write->address, write->bytes), now_, out);
    handler_.tick(now_, out);
    sender_.receive(datagram, now_, out);
    sender_.tick(now_, out);
    acquiring_ = (chance >> 16 & 3) == 0;
    // Never more than a queue of answers, never longer than the protocol's longest.
    check(out.size() <= 64);
    for (const auto& answer : out) {
      check(answer.bytes.size() <= 8 + gige::gvcp_payload_bytes);
      ++answers[{gige::load16(answer.bytes, 2), gige::load16(answer.bytes, 0)}];
    }
    check(settings_.packet_bytes >= 220 && settings_.packet_bytes <= 16000);
  }

  void configure_stream(const gige::StreamSettings& settings) override { settings_ = settings; }
  void fire_test_packet(std::uint32_t packet_bytes) override {
    check(packet_bytes >= 220 && packet_bytes <= 16000);
  }
  void resend(const gige::ResendRequest& request) override { check(request.first <= request.last); }
  void inject_faults(const gige::FaultConfiguration& faults) override {
    check(faults.packet_loss <= 1 && faults.burst >= 1);
  }
  void configure_messages(const gige::MessageChannel& channel) override { sender_.configure(channel); }
  void send_message(int event_id) override {
    gige::ControlHandler::Answers out;
    sender_.queue(event_id, 1, now_, out);
  }
  void stop_acquisition() override {}
  bool acquiring() const override { return acquiring_; }
  Counters counters() const override { return {}; }

  /// How often each command (of the acknowledge) came to each status.
  std::map<std::pair<std::uint16_t, std::uint16_t>, std::uint64_t> answers;

 private:
  static gige::DeviceFacts facts() {
    gige::DeviceFacts facts;
    facts.xml = "<fuzzed/>";
    return facts;
  }
  static void check(bool holds) {
    if (!holds) std::abort();
  }

  PlainCamera camera_;
  gige::ControlHandler handler_;
  gige::MessageSender sender_;
  gige::StreamSettings settings_{.packet_bytes = 16000};
  gige::Time now_{};
  int slow_left_ = 0;  // datagrams
  bool acquiring_ = false;
};

}  // namespace atomcam::test
