#include "atomcam/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <string>
#include <utility>

namespace atomcam {
namespace {

constexpr int width = 30;  // characters of the bar

}  // namespace

Progress::Progress(std::uint64_t total, std::string noun)
    : total_(total), noun_(std::move(noun)), terminal_(isatty(STDERR_FILENO) == 1), shown_(start_) {}

Progress::~Progress() {
  if (!drawn_) return;
  show();
  if (terminal_) fmt::print(stderr, "\n");
}

double Progress::seconds() const {
  return std::chrono::duration<double>(Clock::now() - start_).count();
}

void Progress::update(std::uint64_t done) {
  done_ = done;
  const auto pause = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(10000);
  if (Clock::now() - shown_ < pause) return;
  show();
  shown_ = Clock::now();
  drawn_ = true;
}

void Progress::show() {
  const double rate = static_cast<double>(done_) / std::max(seconds(), 1e-9);
  const auto left =
      rate > 0 ? static_cast<long>(static_cast<double>(total_ - std::min(done_, total_)) / rate + 0.5) : 0;
  std::string text = fmt::format("{} of {} {}, {:.3g} {}/s, {}:{:02} left", done_, total_, noun_, rate, noun_,
                                 left / 60, left % 60);
  if (terminal_) {
    const auto full = static_cast<std::size_t>(width * static_cast<double>(done_) /
                                               static_cast<double>(std::max<std::uint64_t>(1, total_)));
    const std::string bar = std::string(std::min<std::size_t>(full, width), '#');
    fmt::print(stderr, "\r[{:<{}}] {}   ", bar, width, text);
  } else {
    fmt::print(stderr, "{}\n", text);
  }
}

}  // namespace atomcam
