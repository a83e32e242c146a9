#pragma once
// Where the array's image lies in every frame, against where it lies on average.

#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"

namespace atomcam {

struct ImageMotion {
  std::vector<double> x_px, y_px;         // of the frames in which atoms tell; the mean is zero
  double x_error_px = 0, y_error_px = 0;  // rms, by the noise of the pixels

  /// The positions drawn towards their mean until they scatter no more than the image does.
  ImageMotion without_noise() const;
};

/// Least squares over the occupied sites of each frame: the derivative of each site's image, times its
/// brightness. Displacements shall be small against the image of an atom.
ImageMotion image_motion(const StackModel& model, const FrameSequence& frames);

}  // namespace atomcam
