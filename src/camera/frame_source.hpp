#pragma once
// The seam between a camera and its pixels.

#include <cstddef>
#include <cstdint>
#include <string>

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

struct RenderedFrame {
  std::uint64_t number = 0;
  CountImage counts;  // settings.output_height() x settings.output_width(), 16-bit
  std::string truth;  // opaque to the camera; becomes the ground-truth chunk
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// Frame `number` under `settings`. Pure, thread safe, called from several threads at once.
  virtual RenderedFrame render(std::uint64_t number, const CameraSettings& settings) = 0;
  virtual std::uint64_t seed() const = 0;
  /// Most bytes that a frame's truth takes: the ground-truth chunk has this size, padded with NUL. A longer
  /// truth is replaced by a note that says so. Constant while the camera is open.
  virtual std::size_t truth_capacity() const { return 64 * 1024; }
};

}  // namespace atomcam
