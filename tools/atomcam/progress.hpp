#pragma once
// How far a command is, on stderr: a bar on a terminal, a line now and then elsewhere.

#include <chrono>
#include <cstdint>
#include <string>

namespace atomcam {

class Progress {
 public:
  /// `noun`: what is counted, plural.
  explicit Progress(std::uint64_t total, std::string noun = "frames");
  ~Progress();
  void update(std::uint64_t done);
  double seconds() const;

 private:
  using Clock = std::chrono::steady_clock;
  void show();

  std::uint64_t total_, done_ = 0;
  const std::string noun_;
  const bool terminal_;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_;
  bool drawn_ = false;
};

}  // namespace atomcam
