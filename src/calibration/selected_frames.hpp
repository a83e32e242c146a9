#pragma once

#include <functional>

#include "analysis/frame_sequence.hpp"

namespace atomcam {

/// The frames of another sequence that a rule admits; an empty rule admits all. Both must outlive it.
class SelectedFrames : public FrameSequence {
 public:
  SelectedFrames(const FrameSequence& all, const std::function<bool(std::size_t)>& use)
      : all_(all), use_(use) {
    for (std::size_t n = 0; n < all.frames(); ++n) count_ += !use || use(n);
  }
  std::size_t frames() const override { return count_; }
  Shape shape() const override { return all_.shape(); }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    std::size_t k = 0;
    all_.visit([&](std::size_t n, const CountImage& frame) {
      if (!use_ || use_(n)) take(k++, frame);
    });
  }

 private:
  const FrameSequence& all_;
  const std::function<bool(std::size_t)>& use_;
  std::size_t count_ = 0;
};

}  // namespace atomcam
