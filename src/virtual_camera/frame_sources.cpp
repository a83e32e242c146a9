#include "virtual_camera/frame_sources.hpp"

#include <algorithm>

namespace atomcam {

RenderedFrame LiveFrames::render(std::uint64_t number, const CameraSettings& settings) {
  Frame frame = simulation_->render(number, settings);
  return {.number = number, .counts = std::move(frame.counts), .truth = frame.truth.to_json()};
}

RenderedFrame RepeatedFrames::render(std::uint64_t number, const CameraSettings& settings) {
  const std::size_t slot = number % ring_.size();
  // The interval between frames is a matter of the trigger; it does not make a ring stale.
  CameraSettings same = settings;
  same.frame_interval_s = 0;
  Kept kept;
  {
    const std::lock_guard lock(mutex_);
    if (!(settings_ == same)) {
      settings_ = same;
      std::fill(ring_.begin(), ring_.end(), nullptr);
    }
    kept = ring_[slot];
  }
  if (!kept) {
    kept = std::make_shared<const RenderedFrame>(source_->render(slot, settings));
    const std::lock_guard lock(mutex_);
    if (settings_ == same) ring_[slot] = kept;
  }
  RenderedFrame frame = *kept;
  frame.number = number;
  return frame;
}

void RepeatedFrames::fill(const CameraSettings& settings) {
  for (std::size_t slot = 0; slot < ring_.size(); ++slot) render(slot, settings);
}

}  // namespace atomcam
