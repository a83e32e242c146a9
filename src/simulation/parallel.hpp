#pragma once
// A loop shared out over threads. The order of the calls is free, so each must depend on its index alone.

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace atomcam {

/// As many as asked for; as the machine has cores if that is none.
inline int thread_count(int asked = 0) {
  return asked > 0 ? asked : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

/// Calls body(i) for i in [0, count) on `threads` threads (the calling one included), in chunks of `chunk`.
/// The first exception thrown by a call is thrown again here.
template <class Body>
void parallel_for(int count, int threads, int chunk, const Body& body) {
  threads = std::clamp(threads, 1, std::max(1, (count + chunk - 1) / chunk));
  if (threads == 1) {
    for (int i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<int> next{0};
  std::exception_ptr failure;
  std::mutex failure_mutex;
  const auto work = [&] {
    try {
      for (int begin = next.fetch_add(chunk); begin < count; begin = next.fetch_add(chunk))
        for (int i = begin; i < std::min(begin + chunk, count); ++i) body(i);
    } catch (...) {
      const std::lock_guard lock(failure_mutex);
      if (!failure) failure = std::current_exception();
      next = count;
    }
  };
  {
    std::vector<std::jthread> others;
    for (int t = 1; t < threads; ++t) others.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace atomcam
