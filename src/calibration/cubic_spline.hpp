#pragma once
// Between the samples of an image: the cubic B-spline through them.

#include <Eigen/Dense>

namespace atomcam {

/// Cubic B-spline at one sub-pixel position: four weights and their slopes. Through the spline's coefficients
/// the interpolation errs a hundred times less than through four samples, which blurs a narrow image.
struct CubicWeights {
  Eigen::Vector4d value, slope;
  explicit CubicWeights(double t) {  // between coefficients 0 and 1 of -1, 0, 1, 2
    const double s = 1 - t;
    value << s * s * s / 6, 2.0 / 3 - t * t * (2 - t) / 2, 2.0 / 3 - s * s * (2 - s) / 2, t * t * t / 6;
    slope << -s * s / 2, t * (1.5 * t - 2), -s * (1.5 * s - 2), t * t / 2;
  }
};

/// Samples into the coefficients of the cubic B-spline through them, the samples mirrored at the ends.
void to_spline(Eigen::ArrayXXd& samples);

}  // namespace atomcam
