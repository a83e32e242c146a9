#include "diagnosis/chosen_frames.hpp"

#include <algorithm>

#include "analysis/battery.hpp"

namespace atomcam {
namespace {

constexpr std::size_t most_pixels = std::size_t{1} << 24, fewest_frames = 64;

}  // namespace

FrameChoice::FrameChoice(std::size_t all, std::size_t count, std::size_t stretch) : FrameChoice(all) {
  if (count >= all || stretch == 0 || stretch > count) return;
  stretch_ = stretch;
  count_ = count - count % stretch;
}

std::size_t FrameChoice::number(std::size_t k) const {
  const std::size_t stretches = stretch_ > 0 ? count_ / stretch_ : 0;
  if (stretches < 2) return k;
  return k / stretch_ * (all_ - stretch_) / (stretches - 1) + k % stretch_;
}

FrameChoice frames_worth_looking_at(std::size_t frames, const Shape& shape) {
  const std::size_t most = std::max(fewest_frames, most_pixels / std::max<std::size_t>(1, shape.pixels()));
  return {frames, most, 2 * split_of(most).block};
}

void ChosenFrames::visit(const std::function<void(std::size_t, const CountImage&)>& take) const {
  std::size_t k = 0;
  all_.visit([&](std::size_t n, const CountImage& frame) {
    if (k < choice_.count() && n == choice_.number(k)) take(k++, frame);
  });
}

}  // namespace atomcam
