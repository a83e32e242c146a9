#pragma once
// Frames give their memory back: a full frame of 19 MB costs thousands of page faults when it is new.

#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "camera/transport.hpp"

namespace atomcam {

class BufferPool : public std::enable_shared_from_this<BufferPool> {
 public:
  explicit BufferPool(std::size_t most) : most_(most) {}

  /// A frame with an empty payload; when the last holder drops it, its memory comes back here.
  std::shared_ptr<CameraFrame> frame() {
    auto frame = std::make_unique<CameraFrame>();
    {
      const std::lock_guard lock(mutex_);
      if (!buffers_.empty()) {
        frame->payload = std::move(buffers_.back());
        buffers_.pop_back();
      }
    }
    frame->payload.clear();
    return {frame.release(), [pool = shared_from_this()](CameraFrame* used) {
              pool->give(std::move(used->payload));
              delete used;
            }};
  }

 private:
  void give(std::vector<std::uint8_t> buffer) {
    const std::lock_guard lock(mutex_);
    if (buffers_.size() < most_) buffers_.push_back(std::move(buffer));
  }

  const std::size_t most_;
  std::mutex mutex_;
  std::vector<std::vector<std::uint8_t>> buffers_;
};

}  // namespace atomcam
