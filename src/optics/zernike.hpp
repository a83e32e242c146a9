#pragma once
// Zernike terms of radial degree 0 to 4, orthonormal on the unit disc (mean square 1), in the paper's order:
// its index is Noll's minus one. rho is the pupil radius over the aperture's; theta is measured from +x
// (columns) to +y (rows, downwards), so x = rho cos(theta), y = rho sin(theta).
//
//  index  Noll  OSA/ANSI  n   m  name                           polynomial
//    0      1      0      0   0  piston                         1
//    1      2      2      1   1  horizontal tilt                2 rho cos(theta)
//    2      3      1      1  -1  vertical tilt                  2 rho sin(theta)
//    3      4      4      2   0  defocus                        sqrt(3) (2 rho^2 - 1)
//    4      5      3      2  -2  oblique astigmatism            sqrt(6) rho^2 sin(2 theta)
//    5      6      5      2   2  vertical astigmatism           sqrt(6) rho^2 cos(2 theta)
//    6      7      7      3  -1  vertical coma                  sqrt(8) (3 rho^3 - 2 rho) sin(theta)
//    7      8      8      3   1  horizontal coma                sqrt(8) (3 rho^3 - 2 rho) cos(theta)
//    8      9      6      3  -3  vertical trefoil               sqrt(8) rho^3 sin(3 theta)
//    9     10      9      3   3  oblique trefoil                sqrt(8) rho^3 cos(3 theta)
//   10     11     12      4   0  primary spherical              sqrt(5) (6 rho^4 - 6 rho^2 + 1)
//   11     12     13      4   2  vertical secondary astigmatism sqrt(10) (4 rho^4 - 3 rho^2) cos(2 theta)
//   12     13     11      4  -2  oblique secondary astigmatism  sqrt(10) (4 rho^4 - 3 rho^2) sin(2 theta)
//   13     14     14      4   4  vertical quadrafoil            sqrt(10) rho^4 cos(4 theta)
//   14     15     10      4  -4  oblique quadrafoil             sqrt(10) rho^4 sin(4 theta)

#include <array>
#include <span>
#include <string_view>

#include "optics/optics.hpp"

namespace atomcam {

struct ZernikeTerm {
  std::string_view key;  // snake_case
  std::string_view name;
  int noll;
  int osa;
  int degree;     // n
  int frequency;  // m; negative: sine
};

/// All terms, by index.
std::span<const ZernikeTerm, zernike_terms> zernike_catalogue();

/// The value of every term at the pupil point (x, y), in units of the aperture's radius.
std::array<double, zernike_terms> zernike_values(double x, double y);

/// d/dx and d/dy of sum_i coefficients[i] Z_i at (x, y).
struct Slope {
  double x, y;
};
Slope zernike_slope(const std::array<double, zernike_terms>& coefficients, double x, double y);

/// sum_i coefficients[i] Z_i as a polynomial: element [p][q] multiplies x^p y^q.
using PupilPolynomial = std::array<std::array<double, 5>, 5>;
PupilPolynomial zernike_polynomial(const std::array<double, zernike_terms>& coefficients);

}  // namespace atomcam
