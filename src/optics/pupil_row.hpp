#pragma once
// Many samples of the pupil at once, on vectors.

#include <array>
#include <complex>
#include <cstddef>

namespace atomcam {

/// One row of the pupil: the wavefront in turns is the polynomial `turns` of x, and its slopes, in turns from
/// one sample to the next, are the polynomials `slope_x` and `slope_y`. The amplitude is (1 - sine_square_y -
/// sine_square x^2)^(-1/4), the sine condition's, times (1 - edge_loss_y - edge_loss x^2).
struct PupilRow {
  std::array<double, 5> turns;
  std::array<double, 4> slope_x, slope_y;
  double spacing;  // of samples, in aperture radii
  double sine_square, sine_square_y;
  double edge_loss, edge_loss_y;
};

/// Samples are made in multiples of this.
inline constexpr int pupil_row_step = 8;

/// out[n] = amplitude sinc(slope_x) sinc(slope_y) exp(2 pi i turns) at x = (first + n) spacing, n < count, a
/// multiple of pupil_row_step: the mean over the sample's square to first order of the wavefront. The same
/// bits on every instruction set; error below 1e-14. What is beyond the aperture is not a number.
void pupil_row(const PupilRow& row, int first, int count, std::complex<double>* out);

}  // namespace atomcam
