#pragma once
// Frames to be measured, from a file, from memory or out of the simulation.

#include <cstddef>
#include <functional>
#include <vector>

#include "base/image.hpp"

namespace atomcam {

/// Frames that can be gone through more than once, always the same. A visit needs no more memory than a few
/// frames.
class FrameSequence {
 public:
  virtual ~FrameSequence() = default;
  virtual std::size_t frames() const = 0;
  virtual Shape shape() const = 0;
  /// Calls take(n, frame) for n = 0 ... frames() - 1, in this order.
  virtual void visit(const std::function<void(std::size_t, const CountImage&)>& take) const = 0;
};

class FramesInMemory : public FrameSequence {
 public:
  explicit FramesInMemory(std::vector<CountImage> frames) : frames_(std::move(frames)) {}
  std::size_t frames() const override { return frames_.size(); }
  Shape shape() const override { return frames_.empty() ? Shape{} : frames_.front().shape(); }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    for (std::size_t n = 0; n < frames_.size(); ++n) take(n, frames_[n]);
  }

 private:
  std::vector<CountImage> frames_;
};

}  // namespace atomcam
