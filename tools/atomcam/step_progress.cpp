#include "atomcam/step_progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

namespace atomcam {

StepProgress::StepProgress() : terminal_(isatty(STDERR_FILENO) == 1), shown_(start_) {}

StepProgress::~StepProgress() {
  if (drawn_ && terminal_) fmt::print(stderr, "\r{:<70}\r", "");
}

void StepProgress::update(std::string_view step, double done) {
  const std::lock_guard lock(mutex_);
  // At once on a terminal; a log is not told of what takes no time.
  const auto pause =
      terminal_ ? std::chrono::milliseconds(drawn_ ? 100 : 0) : std::chrono::milliseconds(10000);
  if (Clock::now() - shown_ < pause) return;
  show(step, std::clamp(done, 0.0, 1.0));
  shown_ = Clock::now();
  drawn_ = true;
}

void StepProgress::show(std::string_view step, double done) {
  const double spent = std::chrono::duration<double>(Clock::now() - start_).count();
  // An estimate from the first few percent would be a guess.
  std::string left;
  if (done > 0.05) {
    const auto seconds = static_cast<long>(spent * (1 - done) / done + 0.5);
    left = fmt::format(", about {}:{:02} left", seconds / 60, seconds % 60);
  }
  const std::string text = fmt::format("{:3.0f} %  {}{}", 100 * done, step, left);
  if (terminal_)
    fmt::print(stderr, "\r{:<70}", text);
  else
    fmt::print(stderr, "{}\n", text);
}

}  // namespace atomcam
