#pragma once
// The seam between a camera and its pixels.

#include <cstdint>
#include <string>

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

struct RenderedFrame {
  std::uint64_t number = 0;
  CountImage counts;        // settings.output_height() x settings.output_width(), 16-bit
  std::string truth;        // opaque to the camera; becomes the ground-truth chunk
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// Frame `number` under `settings`. Pure, thread safe, called from several threads at once.
  virtual RenderedFrame render(std::uint64_t number, const CameraSettings& settings) = 0;
  virtual std::uint64_t seed() const = 0;
};

}  // namespace atomcam
