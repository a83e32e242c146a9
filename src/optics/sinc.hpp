#pragma once

#include <cmath>

#include "base/math.hpp"

namespace atomcam {

/// sin(pi x) / (pi x), to relative 1e-12: the transform of a square of unit width.
inline double sinc(double x) {
  x = std::fabs(x);
  if (x < 1e-3) return 1 - math::pi * math::pi * x * x / 6;  // sin_turns is exact to 1e-15 absolute only
  return math::sin_turns(x / 2) / (math::pi * x);
}

}  // namespace atomcam
