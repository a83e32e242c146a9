#pragma once
// How far a command of several steps is, on stderr: one line that is overwritten on a terminal, a line now
// and then elsewhere, with an estimate of the time left.

#include <chrono>
#include <mutex>
#include <string>
#include <string_view>

namespace atomcam {

class StepProgress {
 public:
  StepProgress();
  ~StepProgress();
  /// `done`: part of the whole, 0 to 1. May be called by several threads.
  void update(std::string_view step, double done);

 private:
  using Clock = std::chrono::steady_clock;
  void show(std::string_view step, double done);

  const bool terminal_;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_;
  std::mutex mutex_;
  bool drawn_ = false;
};

}  // namespace atomcam
