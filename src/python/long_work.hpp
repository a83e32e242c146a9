#pragma once
// Work that takes seconds or minutes: the interpreter runs on, Ctrl-C ends it, progress is told.

#include <pybind11/pybind11.h>

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace atomcam {

/// Between the threads that work and the one that waits for them.
class LongWork {
 public:
  /// How far the work is; to be called from any thread of it, without the interpreter's lock. Throws if the
  /// work is to end.
  void tell(std::string_view step, double done);
  /// Throws if the work is to end.
  void check_in() const;

  /// Calls work(*this) on a thread of its own. The calling thread, which holds the interpreter's lock, lets
  /// go of it and takes it again some times a second, to look for signals and to call
  /// `progress(step, fraction)` if it is not None; an exception of either ends the work and is thrown here.
  void run(const pybind11::object& progress, const std::function<void(LongWork&)>& work);

 private:
  using News = std::pair<std::string, double>;
  /// What was told since the last call. `finished`: there will be no more.
  std::optional<News> wait(bool& finished);

  std::mutex mutex_;
  std::condition_variable over_;
  std::optional<News> news_;
  double furthest_ = 0;
  bool finished_ = false;
  std::atomic<bool> stop_{false};
};

}  // namespace atomcam
