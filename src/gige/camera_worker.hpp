#pragma once
// Does the camera's slow work in order, on a thread of its own, so that the control thread never waits for a
// camera.

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace atomcam::gige {

class CameraWorker {
 public:
  CameraWorker() : thread_([this] { run(); }) {}
  /// Does what is left first.
  ~CameraWorker() {
    {
      const std::lock_guard lock(mutex_);
      closing_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }

  void post(std::function<void()> work) {
    {
      const std::lock_guard lock(mutex_);
      work_.push_back(std::move(work));
    }
    wake_.notify_one();
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [this] { return closing_ || !work_.empty(); });
      if (work_.empty()) return;
      const std::function<void()> work = std::move(work_.front());
      work_.pop_front();
      lock.unlock();
      work();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<void()>> work_;
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace atomcam::gige
