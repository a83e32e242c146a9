#pragma once

#include <span>

#include "base/image.hpp"
#include "calibration/sensor_fit.hpp"

namespace atomcam {

/// The mean of a stack, in electrons above the dark level.
struct MeanImage {
  Image<double, unit::electrons> electrons;
  Image<double, unit::electrons> variance;       // of the mean, per pixel, e^2; 1e6 and more: not to be used
  Image<double, unit::electrons> dark_variance;  // the part of it that is not shot noise of light
  double variance_per_e = 0;                     // the rest per electron of light
};

/// Of a stack whose pixels have these counts in the dark. `excess`: that of the electron multiplication;
/// `dark_variance_e2`: of a pixel's mean, without light. Pixels that no light explains have no weight.
MeanImage mean_image(const StackSums& light, std::span<const double> dark_counts, double counts_per_electron,
                     double excess, double dark_variance_e2);

}  // namespace atomcam
