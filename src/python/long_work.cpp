#include "python/long_work.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <thread>

namespace py = pybind11;

namespace atomcam {
namespace {

constexpr auto pause = std::chrono::milliseconds(50);

struct Stopped : std::exception {};

}  // namespace

void LongWork::check_in() const {
  if (stop_) throw Stopped();
}

void LongWork::tell(std::string_view step, double done) {
  check_in();
  const std::lock_guard lock(mutex_);
  // Threads may overtake each other between their sums and this call.
  furthest_ = std::clamp(done, furthest_, 1.0);
  news_ = News(step, furthest_);
}

std::optional<LongWork::News> LongWork::wait(bool& finished) {
  std::unique_lock lock(mutex_);
  over_.wait_for(lock, pause, [&] { return finished_; });
  finished = finished_;
  return std::exchange(news_, std::nullopt);
}

void LongWork::run(const py::object& progress, const std::function<void(LongWork&)>& work) {
  std::exception_ptr failure;
  {
    py::gil_scoped_release others_run;
    const std::jthread worker([&] {
      try {
        work(*this);
      } catch (...) {
        failure = std::current_exception();
      }
      const std::lock_guard lock(mutex_);
      finished_ = true;
      over_.notify_all();
    });
    for (bool finished = false; !finished;) {
      const std::optional<News> news = wait(finished);
      const py::gil_scoped_acquire hold;
      try {
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (news && !progress.is_none()) progress(news->first, news->second);
      } catch (...) {
        stop_ = true;
        throw;
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace atomcam
