#pragma once
// Two models with the real cameras' figures, a source of ramps and a sink that keeps what it gets.

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "camera/camera.hpp"

namespace atomcam::test {

inline CameraModel ixon_model() {
  CameraModel model;
  model.kind = CameraKind::emccd;
  model.model = "iXon Ultra 897";
  model.version = "1.0";
  model.serial = "X-8172";
  model.user_name = "atoms";
  model.sensor = {512, 512};
  model.pixel_um = 16;
  const auto add = [&](Amplifier amplifier, double rate_hz, std::vector<double> noise_e,
                       std::vector<double> scale) {
    const char* labels[] = {"1x", "2x", "3x"};
    for (std::size_t i = 0; i < 3; ++i)
      model.readout_modes.push_back(
          {amplifier, ScanMode::standard, rate_hz, labels[i], scale[i], noise_e[i]});
  };
  add(Amplifier::electron_multiplying, 17e6, {240, 120, 80}, {15, 7.5, 5});
  add(Amplifier::electron_multiplying, 10e6, {130, 80, 60}, {15, 7.5, 5});
  add(Amplifier::electron_multiplying, 5e6, {67, 44, 37}, {15, 7.5, 5});
  add(Amplifier::conventional, 3e6, {13, 11, 9}, {3.8, 3.0, 1.4});
  model.power_up.region = {0, 0, 512, 512};
  return model;
}

inline CameraModel orca_model() {
  CameraModel model;
  model.kind = CameraKind::qcmos;
  model.model = "ORCA-Quest C15550-20UP";
  model.version = "1.0";
  model.serial = "S/N 000123";
  model.sensor = {2304, 4096};
  model.pixel_um = 4.6;
  model.readout_modes.push_back({Amplifier::conventional, ScanMode::standard, 0, "", 0.107, 0.43});
  model.readout_modes.push_back({Amplifier::conventional, ScanMode::ultra_quiet, 0, "", 0.107, 0.27});
  model.power_up.region = {0, 0, 4096, 2304};
  model.power_up.exposure_s = 8.2944e-3;
  model.power_up.frame_interval_s = 0;
  model.power_up.sensor_temperature_c = -20;
  return model;
}

/// Pixel (row, column) of frame n counts 16 * (row + column + n), so that frames and places can be told
/// apart.
class RampSource : public FrameSource {
 public:
  RenderedFrame render(std::uint64_t number, const CameraSettings& settings) override {
    ++renders;
    if (before) before(number);
    if (delay.load().count() > 0) std::this_thread::sleep_for(delay.load());
    if (fail && fail(number)) throw std::runtime_error("no frame");
    RenderedFrame frame;
    frame.number = number;
    frame.counts = CountImage(Shape{settings.output_height(), settings.output_width()});
    for (int r = 0; r < frame.counts.rows(); ++r)
      for (int c = 0; c < frame.counts.columns(); ++c)
        frame.counts(r, c) = static_cast<std::uint16_t>(16 * (r + c + static_cast<int>(number)));
    frame.truth = truth ? truth(number) : "{\"frame\":" + std::to_string(number) + "}";
    {
      const std::lock_guard lock(mutex_);
      last_ = settings;
      by_frame_.emplace_back(number, settings);
    }
    return frame;
  }
  std::uint64_t seed() const override { return 0x9123456789abcdef; }
  std::size_t truth_capacity() const override { return 1022; }

  CameraSettings last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  /// Settings of the last rendering of frame `number`.
  CameraSettings of(std::uint64_t number) const {
    const std::lock_guard lock(mutex_);
    for (auto i = by_frame_.rbegin(); i != by_frame_.rend(); ++i)
      if (i->first == number) return i->second;
    return {};
  }

  std::atomic<int> renders = 0;
  std::atomic<std::chrono::milliseconds> delay{std::chrono::milliseconds(0)};
  // Set before the acquisition starts.
  std::function<void(std::uint64_t)> before;
  std::function<bool(std::uint64_t)> fail;
  std::function<std::string(std::uint64_t)> truth;

 private:
  mutable std::mutex mutex_;
  CameraSettings last_;
  std::vector<std::pair<std::uint64_t, CameraSettings>> by_frame_;
};

class RecordingSink : public FrameSink {
 public:
  void deliver(std::shared_ptr<const CameraFrame> frame) override {
    const std::lock_guard lock(mutex_);
    frames_.push_back(std::move(frame));
    arrivals_.push_back(std::chrono::steady_clock::now());
    changed_.notify_all();
  }
  void notify(const CameraEvent& event) override {
    const std::lock_guard lock(mutex_);
    events_.push_back(event);
    changed_.notify_all();
  }
  void acquisition_started() override {
    const std::lock_guard lock(mutex_);
    ++started_;
    changed_.notify_all();
  }
  void acquisition_stopped() override {
    const std::lock_guard lock(mutex_);
    ++stopped_;
    changed_.notify_all();
  }

  bool wait_frames(std::size_t count) {
    return wait([&] { return frames_.size() >= count; });
  }
  bool wait_events(std::size_t count) {
    return wait([&] { return events_.size() >= count; });
  }
  bool wait_stopped(int count) {
    return wait([&] { return stopped_ >= count; });
  }
  std::vector<std::shared_ptr<const CameraFrame>> frames() const {
    const std::lock_guard lock(mutex_);
    return frames_;
  }
  std::vector<CameraEvent> events() const {
    const std::lock_guard lock(mutex_);
    return events_;
  }
  std::vector<std::chrono::steady_clock::time_point> arrivals() const {
    const std::lock_guard lock(mutex_);
    return arrivals_;
  }
  int started() const {
    const std::lock_guard lock(mutex_);
    return started_;
  }

 private:
  template <class Condition>
  bool wait(Condition condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), condition);
  }
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::shared_ptr<const CameraFrame>> frames_;
  std::vector<std::chrono::steady_clock::time_point> arrivals_;
  std::vector<CameraEvent> events_;
  int started_ = 0, stopped_ = 0;
};

/// A camera with its source and sink; the sink is detached before it goes.
struct Bench {
  explicit Bench(CameraModel model, std::vector<SourceControl> controls = {})
      : source(std::make_shared<RampSource>()),
        camera(Camera::open(std::move(model), source, std::move(controls))) {
    camera->attach(&sink);
  }
  ~Bench() { camera->attach(nullptr); }

  std::int64_t integer(const char* feature) { return std::get<std::int64_t>(camera->get(feature)); }
  double floating(const char* feature) { return std::get<double>(camera->get(feature)); }
  bool on(const char* feature) { return std::get<bool>(camera->get(feature)); }
  std::string text(const char* feature) { return std::get<std::string>(camera->get(feature)); }
  void set(const char* feature, std::int64_t value) { camera->set(feature, value); }
  void set(const char* feature, int value) { camera->set(feature, std::int64_t{value}); }
  void set(const char* feature, double value) { camera->set(feature, value); }
  void set(const char* feature, bool value) { camera->set(feature, value); }
  void set(const char* feature, const char* value) { camera->set(feature, std::string(value)); }

  std::shared_ptr<RampSource> source;
  RecordingSink sink;
  std::unique_ptr<Camera> camera;
};

/// A small, fast image: 64 x 64 at the fastest settings.
inline void make_small(Bench& bench) {
  bench.set("Width", 64);
  bench.set("Height", 64);
  if (bench.camera->settings().frame_interval_s > 0.05) bench.set("AcquisitionFrameRateEnable", false);
  bench.set("ExposureTime", std::max(5000.0, bench.camera->range("ExposureTime").minimum));
}

}  // namespace atomcam::test
