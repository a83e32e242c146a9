#pragma once
// Frames in time. Exposures start on an absolute schedule, on triggers or on the edges of a simulated line;
// frames are rendered ahead on worker threads and handed out in order when exposure and readout are over. If
// rendering is slower than the camera, frames come late and the schedule slips; free running, none is
// skipped.
//
// One mutex, held only for bookkeeping: rendering, packing and delivery run without it, so control never
// waits for them.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <variant>
#include <vector>

#include "camera/buffer_pool.hpp"
#include "camera/feature_state.hpp"
#include "camera/frame_source.hpp"
#include "camera/payload.hpp"
#include "camera/thermal.hpp"
#include "camera/timing.hpp"
#include "camera/transport.hpp"

namespace atomcam {

/// Everything about exposures to come that features decide.
struct ExposurePlan {
  CameraSettings settings;  // its temperature is the thermal model's at the start of the exposure
  PayloadLayout layout;
  FrameTiming timing;
  double chunk_gain = 1;  // EM gain as the chunk tells it
  std::int64_t seed = 0;
  ThermalModel thermal;

  enum class Trigger { none, software, line, action };
  Trigger trigger = Trigger::none;
  int action_signal = 0;
  double trigger_delay_s = 0;
  bool trigger_overlap = false;
  double line_rate_hz = 0;
  bool line_inverted = false;
  bool falling_edge = false;
  bool notify_exposure_end = false, notify_lost = false;
  bool operator==(const ExposurePlan&) const = default;
};

class Acquisition {
 public:
  Acquisition(std::shared_ptr<FrameSource> source, int render_threads);
  ~Acquisition();

  /// Frames whose exposure has not begun are rendered anew if the plan has changed.
  void configure(const ExposurePlan& plan);
  /// `frames`: 0 = until stopped. Does nothing while acquiring.
  void start(std::uint64_t frames);
  /// At once. Frames that have not been delivered have not happened; their numbers come again.
  void stop();
  void software_trigger();
  void action(int signal);
  void attach(FrameSink* sink);
  void report_lost(std::uint64_t frame);

  std::uint64_t clock_ns() const;
  void reset_clock();
  double seconds_open() const;
  /// The part of the live values that the acquisition knows.
  void fill(LiveValues& live) const;
  Camera::Statistics statistics() const;

 private:
  using Nanoseconds = std::int64_t;  // since the camera was opened

  struct Exposure {
    std::uint64_t number = 0;
    ExposurePlan plan;
    std::optional<Nanoseconds> start;  // empty: waits for a trigger
    Nanoseconds end = 0, ready = 0;
    bool begun = false;  // settings are final
    bool end_told = false;
    enum class Pixels { wanted, rendering, ready, failed } pixels = Pixels::wanted;
    Nanoseconds rendered_at = 0;
    std::shared_ptr<CameraFrame> frame;
    bool discarded = false;
  };
  using ExposurePointer = std::shared_ptr<Exposure>;
  struct Started {};
  struct Stopped {};
  using Notice = std::variant<Started, Stopped, CameraEvent>;

  Nanoseconds now() const;
  std::uint64_t device_time(Nanoseconds time) const;
  void keep_time();      // thread: schedule and delivery
  void render_frames();  // threads

  // All with the mutex held.
  ExposurePointer make_exposure(std::uint64_t number) const;
  void set_start(Exposure& exposure, Nanoseconds start) const;
  Nanoseconds earliest_start(const FrameTiming& timing, double exposure_s, bool overlap) const;
  void begin_due(Nanoseconds time);
  void tell_ended(Nanoseconds time);
  void take_line_edges(Nanoseconds time);
  void trigger(Nanoseconds time);
  void plan_ahead(Nanoseconds time);
  void renew_waiting(Nanoseconds time);
  void finish();
  void lose(std::uint64_t frame, Nanoseconds time);
  std::optional<Nanoseconds> next_moment() const;
  Nanoseconds line_edge(std::int64_t index) const;
  void align_line(Nanoseconds time);
  bool waits_for_trigger(Nanoseconds time) const;

  std::shared_ptr<FrameSource> source_;
  const std::shared_ptr<BufferPool> pool_;
  const std::size_t depth_;  // exposures under way or planned
  const std::chrono::steady_clock::time_point opened_ = std::chrono::steady_clock::now();

  mutable std::mutex mutex_;
  std::condition_variable schedule_changed_, work_;
  bool closing_ = false;
  bool acquiring_ = false;
  std::uint64_t frames_left_ = 0;  // still to be planned; only if counted_
  bool counted_ = false;
  std::uint64_t frames_undelivered_ = 0;
  ExposurePlan plan_;
  std::deque<ExposurePointer> exposures_;  // in order; begun ones first
  std::uint64_t next_number_ = 0;
  std::int64_t next_edge_ = 0;  // index of the line's next edge
  struct Last {                 // the exposure that began last in this acquisition
    Nanoseconds start = 0, end = 0, readout = 0;
  };
  std::optional<Last> last_;
  std::deque<Notice> notices_;
  Nanoseconds clock_zero_ = 0;
  Camera::Statistics statistics_;
  std::deque<Nanoseconds> delivered_at_;
  std::uint64_t exposure_end_frame_ = 0, exposure_end_ns_ = 0, lost_frame_ = 0, lost_ns_ = 0;

  std::mutex sink_mutex_;  // held while the sink is called
  FrameSink* sink_ = nullptr;

  std::vector<std::thread> threads_;
};

}  // namespace atomcam
