#include "camera/acquisition.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

namespace atomcam {

namespace {

constexpr std::int64_t trigger_tolerance_ns =
    1000;                                // of a trigger that comes just when the camera gets ready
constexpr std::size_t rate_window = 32;  // deliveries over which the frame rate is measured

constexpr int render_niceness = 5;

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * 1e9);
}

template <class... Handlers>
struct Overloaded : Handlers... {
  using Handlers::operator()...;
};
template <class... Handlers>
Overloaded(Handlers...) -> Overloaded<Handlers...>;

}  // namespace

Acquisition::Acquisition(std::shared_ptr<FrameSource> source, int render_threads)
    : source_(std::move(source)),
      pool_(std::make_shared<BufferPool>(2 * static_cast<std::size_t>(std::max(render_threads, 1)) + 4)),
      depth_(2 * static_cast<std::size_t>(std::max(render_threads, 1)) + 2) {
  threads_.emplace_back([this] { keep_time(); });
  for (int i = 0; i < std::max(render_threads, 1); ++i) threads_.emplace_back([this] { render_frames(); });
}

Acquisition::~Acquisition() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  schedule_changed_.notify_all();
  work_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

Acquisition::Nanoseconds Acquisition::now() const {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - opened_)
      .count();
}

std::uint64_t Acquisition::device_time(Nanoseconds time) const {
  return static_cast<std::uint64_t>(std::max<Nanoseconds>(time - clock_zero_, 0));
}

std::uint64_t Acquisition::clock_ns() const {
  const std::lock_guard lock(mutex_);
  return device_time(now());
}

void Acquisition::reset_clock() {
  const std::lock_guard lock(mutex_);
  clock_zero_ = now();
}

double Acquisition::seconds_open() const {
  return static_cast<double>(now()) / 1e9;
}

void Acquisition::configure(const ExposurePlan& plan) {
  {
    const std::lock_guard lock(mutex_);
    if (plan == plan_) return;
    const Nanoseconds time = now();
    begin_due(time);
    take_line_edges(time);
    const bool line_changed = plan.line_rate_hz != plan_.line_rate_hz ||
                              plan.falling_edge != plan_.falling_edge ||
                              plan.line_inverted != plan_.line_inverted;
    plan_ = plan;
    if (line_changed) align_line(time);
    renew_waiting(time);
  }
  schedule_changed_.notify_one();
  work_.notify_all();
}

void Acquisition::start(std::uint64_t frames) {
  {
    const std::lock_guard lock(mutex_);
    if (acquiring_) return;
    acquiring_ = true;
    counted_ = frames > 0;
    frames_left_ = frames_undelivered_ = frames;
    last_.reset();
    delivered_at_.clear();
    const Nanoseconds time = now();
    align_line(time);
    notices_.emplace_back(Started{});
    plan_ahead(time);
  }
  schedule_changed_.notify_one();
  work_.notify_all();
}

void Acquisition::stop() {
  {
    const std::lock_guard lock(mutex_);
    if (!acquiring_) return;
    if (!exposures_.empty()) next_number_ = exposures_.front()->number;
    finish();
  }
  schedule_changed_.notify_one();
}

void Acquisition::finish() {
  for (const ExposurePointer& exposure : exposures_) exposure->discarded = true;
  exposures_.clear();
  acquiring_ = false;
  notices_.emplace_back(Stopped{});
}

void Acquisition::software_trigger() {
  {
    const std::lock_guard lock(mutex_);
    if (!acquiring_ || plan_.trigger != ExposurePlan::Trigger::software) return;
    trigger(now());
  }
  schedule_changed_.notify_one();
}

void Acquisition::action(int signal) {
  {
    const std::lock_guard lock(mutex_);
    if (!acquiring_ || plan_.trigger != ExposurePlan::Trigger::action || plan_.action_signal != signal)
      return;
    trigger(now());
  }
  schedule_changed_.notify_one();
}

void Acquisition::attach(FrameSink* sink) {
  const std::lock_guard lock(sink_mutex_);
  sink_ = sink;
}

void Acquisition::report_lost(std::uint64_t frame) {
  {
    const std::lock_guard lock(mutex_);
    lose(frame, now());
  }
  schedule_changed_.notify_one();
}

void Acquisition::lose(std::uint64_t frame, Nanoseconds time) {
  ++statistics_.lost_frames;
  lost_frame_ = frame;
  lost_ns_ = device_time(time);
  if (plan_.notify_lost) notices_.emplace_back(CameraEvent{CameraEvent::Kind::frame_lost, frame, lost_ns_});
}

Camera::Statistics Acquisition::statistics() const {
  const std::lock_guard lock(mutex_);
  Camera::Statistics statistics = statistics_;
  if (acquiring_ && delivered_at_.size() > 1) {
    const auto span = static_cast<double>(delivered_at_.back() - delivered_at_.front());
    if (span > 0) statistics.frame_rate_hz = 1e9 * static_cast<double>(delivered_at_.size() - 1) / span;
  }
  return statistics;
}

void Acquisition::fill(LiveValues& live) const {
  live.statistics = statistics();
  const std::lock_guard lock(mutex_);
  const Nanoseconds time = now();
  live.acquiring = acquiring_;
  live.exposing = live.frame_active = false;
  for (const ExposurePointer& exposure : exposures_) {
    if (!exposure->start || *exposure->start > time) break;
    live.exposing = live.exposing || time < exposure->end;
    live.frame_active = live.frame_active || time < exposure->ready;
  }
  live.waiting_for_trigger = waits_for_trigger(time);
  const double period_ns = plan_.line_rate_hz > 0 ? 1e9 / plan_.line_rate_hz : 0;
  live.line_input = period_ns > 0 && std::fmod(static_cast<double>(time), period_ns) < period_ns / 2;
  live.exposure_end_frame = exposure_end_frame_;
  live.exposure_end_ns = exposure_end_ns_;
  live.lost_frame = lost_frame_;
  live.lost_ns = lost_ns_;
}

bool Acquisition::waits_for_trigger(Nanoseconds time) const {
  if (!acquiring_ || plan_.trigger == ExposurePlan::Trigger::none || exposures_.empty()) return false;
  if (exposures_.back()->start) return false;  // all are taken
  const bool armed = std::any_of(exposures_.begin(), exposures_.end(),
                                 [](const ExposurePointer& e) { return e->start && !e->begun; });
  return !armed && earliest_start(plan_.timing, plan_.settings.exposure_s, plan_.trigger_overlap) <= time;
}

Acquisition::ExposurePointer Acquisition::make_exposure(std::uint64_t number) const {
  auto exposure = std::make_shared<Exposure>();
  exposure->number = number;
  exposure->plan = plan_;
  return exposure;
}

void Acquisition::set_start(Exposure& exposure, Nanoseconds start) const {
  exposure.start = start;
  exposure.end = start + nanoseconds(exposure.plan.settings.exposure_s);
  exposure.ready = exposure.end + nanoseconds(exposure.plan.timing.readout_s);
}

// The sensor is free for an exposure as soon as the one before has ended, if that one's readout may run
// meanwhile and is over before this exposure ends; else when that readout is over.
Acquisition::Nanoseconds Acquisition::earliest_start(const FrameTiming& timing, double exposure_s,
                                                     bool overlap) const {
  if (!last_) return 0;
  const Nanoseconds readout = last_->readout;
  if (!overlap || !timing.overlap) return last_->end + readout;
  return last_->end + std::max<Nanoseconds>(0, readout - nanoseconds(exposure_s));
}

void Acquisition::begin_due(Nanoseconds time) {
  for (const ExposurePointer& exposure : exposures_) {
    if (exposure->begun) continue;
    if (!exposure->start || *exposure->start > time) break;
    exposure->begun = true;
    last_ = Last{*exposure->start, exposure->end, exposure->ready - exposure->end};
  }
}

void Acquisition::tell_ended(Nanoseconds time) {
  for (const ExposurePointer& exposure : exposures_) {
    if (!exposure->begun || exposure->end > time) break;
    if (exposure->end_told) continue;
    exposure->end_told = true;
    exposure_end_frame_ = exposure->number;
    exposure_end_ns_ = device_time(exposure->end);
    if (plan_.notify_exposure_end)
      notices_.emplace_back(CameraEvent{CameraEvent::Kind::exposure_end, exposure->number, exposure_end_ns_});
  }
}

// The line is high in the first half of every period since the camera was opened.
Acquisition::Nanoseconds Acquisition::line_edge(std::int64_t index) const {
  const double half = plan_.falling_edge != plan_.line_inverted ? 0.5 : 0.0;
  return std::llround((static_cast<double>(index) + half) * 1e9 / plan_.line_rate_hz);
}

void Acquisition::align_line(Nanoseconds time) {
  if (plan_.line_rate_hz <= 0) return;
  next_edge_ = static_cast<std::int64_t>(static_cast<double>(time) * plan_.line_rate_hz / 1e9);
  while (line_edge(next_edge_) <= time) ++next_edge_;
}

void Acquisition::take_line_edges(Nanoseconds time) {
  if (!acquiring_ || plan_.trigger != ExposurePlan::Trigger::line || plan_.line_rate_hz <= 0) return;
  for (; line_edge(next_edge_) <= time; ++next_edge_) {
    begin_due(line_edge(next_edge_));
    trigger(line_edge(next_edge_));
  }
}

// Takes the next waiting frame, if the sensor is free when the delay is over and no other trigger is being
// delayed.
void Acquisition::trigger(Nanoseconds time) {
  const Nanoseconds start = time + nanoseconds(plan_.trigger_delay_s);
  begin_due(time);
  const auto waiting =
      std::find_if(exposures_.begin(), exposures_.end(), [](const ExposurePointer& e) { return !e->begun; });
  const bool free = waiting != exposures_.end() && !(*waiting)->start;
  if (!free || start + trigger_tolerance_ns <
                   earliest_start(plan_.timing, plan_.settings.exposure_s, plan_.trigger_overlap)) {
    ++statistics_.missed_triggers;
    return;
  }
  set_start(**waiting, start);
}

void Acquisition::plan_ahead(Nanoseconds time) {
  if (!acquiring_) return;
  bool added = false;
  while (exposures_.size() < depth_ && (!counted_ || frames_left_ > 0)) {
    ExposurePointer exposure = make_exposure(next_number_++);
    if (counted_) --frames_left_;
    if (plan_.trigger == ExposurePlan::Trigger::none) {
      Last before = last_.value_or(Last{});
      bool first = !last_;
      if (!exposures_.empty() && !exposures_.back()->begun) {
        const Exposure& back = *exposures_.back();
        before = {*back.start, back.end, back.ready - back.end};
        first = false;
      }
      Nanoseconds start = time;
      if (!first) {
        const double exposure_s = plan_.settings.exposure_s;
        const Nanoseconds wait = plan_.timing.overlap
                                     ? std::max<Nanoseconds>(0, before.readout - nanoseconds(exposure_s))
                                     : before.readout;
        start =
            std::max({before.end + wait, before.start + nanoseconds(plan_.settings.frame_interval_s), time});
      }
      set_start(*exposure, start);
    }
    exposure->plan.settings.sensor_temperature_c =
        plan_.thermal.stepped(static_cast<double>(exposure->start.value_or(time)) / 1e9);
    exposures_.push_back(std::move(exposure));
    added = true;
  }
  if (added) work_.notify_all();
}

// After a change of plan: frames not yet exposing are planned anew under their numbers; a delayed trigger is
// kept.
void Acquisition::renew_waiting(Nanoseconds time) {
  std::optional<Nanoseconds> armed;
  while (!exposures_.empty() && !exposures_.back()->begun) {
    Exposure& exposure = *exposures_.back();
    if (exposure.plan.trigger != ExposurePlan::Trigger::none && exposure.start) armed = exposure.start;
    exposure.discarded = true;
    next_number_ = exposure.number;
    if (counted_) ++frames_left_;
    exposures_.pop_back();
  }
  plan_ahead(time);
  if (armed && plan_.trigger != ExposurePlan::Trigger::none)
    for (const ExposurePointer& exposure : exposures_)
      if (!exposure->begun) {
        set_start(*exposure, *armed);
        break;
      }
}

std::optional<Acquisition::Nanoseconds> Acquisition::next_moment() const {
  std::optional<Nanoseconds> next;
  const auto consider = [&](Nanoseconds moment) { next = next ? std::min(*next, moment) : moment; };
  for (const ExposurePointer& exposure : exposures_) {
    if (!exposure->start) break;
    if (!exposure->begun) {
      consider(*exposure->start);
      break;
    }
    if (!exposure->end_told) consider(exposure->end);
  }
  if (!exposures_.empty()) {
    const Exposure& front = *exposures_.front();
    if (front.begun && front.pixels >= Exposure::Pixels::ready) consider(front.ready);
  }
  if (acquiring_ && plan_.trigger == ExposurePlan::Trigger::line && plan_.line_rate_hz > 0)
    consider(line_edge(next_edge_));
  return next;
}

void Acquisition::keep_time() {
  std::unique_lock lock(mutex_);
  while (!closing_) {
    const Nanoseconds time = now();
    take_line_edges(time);
    begin_due(time);
    tell_ended(time);

    if (!notices_.empty()) {
      const Notice notice = notices_.front();
      notices_.pop_front();
      lock.unlock();
      {
        const std::lock_guard sink_lock(sink_mutex_);
        if (sink_ != nullptr)
          std::visit(Overloaded{[&](Started) { sink_->acquisition_started(); },
                                [&](Stopped) { sink_->acquisition_stopped(); },
                                [&](const CameraEvent& event) { sink_->notify(event); }},
                     notice);
      }
      lock.lock();
      continue;
    }

    if (!exposures_.empty()) {
      const ExposurePointer front = exposures_.front();
      if (front->begun && front->pixels >= Exposure::Pixels::ready && front->ready <= time) {
        exposures_.pop_front();
        std::shared_ptr<CameraFrame> frame;
        if (front->pixels == Exposure::Pixels::ready) {
          frame = std::move(front->frame);
          stamp_frame(*frame, front->plan.layout, device_time(*front->start));
          ++statistics_.frames;
          if (front->rendered_at > front->ready) ++statistics_.late_frames;
          delivered_at_.push_back(time);
          if (delivered_at_.size() > rate_window) delivered_at_.pop_front();
        } else {
          lose(front->number, time);
        }
        plan_ahead(time);
        if (counted_ && --frames_undelivered_ == 0) finish();
        if (frame) {
          lock.unlock();
          {
            const std::lock_guard sink_lock(sink_mutex_);
            if (sink_ != nullptr) sink_->deliver(std::move(frame));
          }
          lock.lock();
        }
        continue;
      }
    }

    const auto moment = next_moment();
    if (moment)
      schedule_changed_.wait_until(lock, opened_ + std::chrono::nanoseconds(*moment));
    else
      schedule_changed_.wait(lock);
  }
}

void Acquisition::render_frames() {
  // Behind the threads that answer clients and send frames. Concerns this thread only; if refused, nothing is
  // lost.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), render_niceness);
  std::unique_lock lock(mutex_);
  while (!closing_) {
    const auto found = std::find_if(exposures_.begin(), exposures_.end(), [](const ExposurePointer& e) {
      return e->pixels == Exposure::Pixels::wanted;
    });
    if (found == exposures_.end()) {
      work_.wait(lock);
      continue;
    }
    const ExposurePointer exposure = *found;
    exposure->pixels = Exposure::Pixels::rendering;
    const ExposurePlan plan = exposure->plan;
    lock.unlock();

    std::shared_ptr<CameraFrame> frame;
    try {
      const RenderedFrame rendered = source_->render(exposure->number, plan.settings);
      const Shape shape{static_cast<int>(plan.layout.height), static_cast<int>(plan.layout.width)};
      if (rendered.counts.shape() == shape) {
        frame = pool_->frame();
        fill_frame(*frame, rendered, plan.layout,
                   {exposure->number, 0, plan.settings.exposure_s * 1e6, plan.chunk_gain, plan.seed});
      }
    } catch (const std::exception&) {
      // The frame counts as lost; see LostFrameCount.
    }

    lock.lock();
    exposure->rendered_at = now();
    if (!exposure->discarded) {
      exposure->pixels = frame ? Exposure::Pixels::ready : Exposure::Pixels::failed;
      exposure->frame = std::move(frame);
      schedule_changed_.notify_one();
    }
  }
}

}  // namespace atomcam
