#include "base/math.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace atomcam::math {

double log(double x) {
  // x = 2^k m, m in [sqrt(1/2), sqrt(2)); ln m = 2 atanh(s), s = (m - 1) / (m + 1), by its series to s^21.
  const auto bits = std::bit_cast<std::uint64_t>(x);
  int exponent = static_cast<int>(bits >> 52) - 1023;
  double m = std::bit_cast<double>((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  if (m > 1.4142135623730951) {
    m *= 0.5;
    ++exponent;
  }
  const double s = (m - 1) / (m + 1);
  const double q = s * s;
  double series = 1.0 / 23;
  for (int n = 21; n >= 3; n -= 2) series = series * q + 1.0 / n;
  // ln 2 in two parts: the high part times an exponent is exact.
  constexpr double ln2_high = 6.93147180369123816490e-01, ln2_low = 1.90821492927058770002e-10;
  return exponent * ln2_high + (2 * s + (2 * s * q * series + exponent * ln2_low));
}

double exp(double x) {
  if (x > 709) return std::numeric_limits<double>::infinity();
  if (x < -708) return 0;
  constexpr double ln2_high = 6.93147180369123816490e-01, ln2_low = 1.90821492927058770002e-10;
  const double k = std::floor(x * 1.44269504088896340736 + 0.5);
  const double r = (x - k * ln2_high) - k * ln2_low;
  double series = 1;
  for (int n = 13; n >= 1; --n) series = series * r / n + 1;
  return series *
         std::bit_cast<double>(static_cast<std::uint64_t>(static_cast<std::int64_t>(k) + 1023) << 52);
}

namespace {

double sin_series(double a) {  // |a| <= pi / 4
  const double q = a * a;
  double series = 1;
  for (int n = 16; n >= 2; n -= 2) series = 1 - series * q / (n * (n + 1));
  return a * series;
}

double cos_series(double a) {
  const double q = a * a;
  double series = 1;
  for (int n = 17; n >= 1; n -= 2) series = 1 - series * q / (n * (n + 1));
  return series;
}

}  // namespace

double sin_turns(double x) {
  x -= std::floor(x);
  const int octant = static_cast<int>(x * 8);
  switch (octant) {
    case 0:
      return sin_series(2 * pi * x);
    case 1:
    case 2:
      return cos_series(2 * pi * (x - 0.25));
    case 3:
    case 4:
      return -sin_series(2 * pi * (x - 0.5));
    case 5:
    case 6:
      return -cos_series(2 * pi * (x - 0.75));
    default:
      return sin_series(2 * pi * (x - 1));
  }
}

double cos_turns(double x) {
  return sin_turns(x + 0.25);
}

double log_gamma(double x) {
  // Recurrence up to x >= 10, then Stirling's series.
  double shift = 1;
  while (x < 10) {
    shift *= x;
    x += 1;
  }
  const double r = 1 / x, q = r * r;
  const double series =
      r * (1.0 / 12 -
           q * (1.0 / 360 - q * (1.0 / 1260 - q * (1.0 / 1680 - q * (1.0 / 1188 - q * 691.0 / 360360)))));
  return (x - 0.5) * log(x) - x + 0.91893853320467274178 + series - log(shift);
}

double normal_quantile(double p) {
  const double q = p - 0.5;
  if (q >= -0.425 && q <= 0.425) {
    const double r = 0.180625 - q * q;
    const double numerator =
        (((((((r * 2509.0809287301226727 + 33430.575583588128105) * r + 67265.770927008700853) * r +
             45921.953931549871457) *
                r +
            13731.693765509461125) *
               r +
           1971.5909503065514427) *
              r +
          133.14166789178437745) *
             r +
         3.387132872796366608);
    const double denominator =
        (((((((r * 5226.495278852545925 + 28729.085735721942674) * r + 39307.89580009271061) * r +
             21213.794301586595867) *
                r +
            5394.1960214247511077) *
               r +
           687.1870074920579083) *
              r +
          42.313330701600911252) *
             r +
         1);
    return q * numerator / denominator;
  }
  double r = std::sqrt(-log(q < 0 ? p : 1 - p));
  double value;
  if (r <= 5) {
    r -= 1.6;
    value =
        (((((((r * 7.7454501427834140764e-4 + 0.0227238449892691845833) * r + 0.24178072517745061177) * r +
             1.27045825245236838258) *
                r +
            3.64784832476320460504) *
               r +
           5.7694972214606914055) *
              r +
          4.6303378461565452959) *
             r +
         1.42343711074968357734) /
        (((((((r * 1.05075007164441684324e-9 + 5.475938084995344946e-4) * r + 0.0151986665636164571966) * r +
             0.14810397642748007459) *
                r +
            0.68976733498510000455) *
               r +
           1.6763848301838038494) *
              r +
          2.05319162663775882187) *
             r +
         1);
  } else {
    r -= 5;
    value =
        (((((((r * 2.01033439929228813265e-7 + 2.71155556874348757815e-5) * r + 0.0012426609473880784386) *
                 r +
             0.026532189526576123093) *
                r +
            0.29656057182850489123) *
               r +
           1.7848265399172913358) *
              r +
          5.4637849111641143699) *
             r +
         6.6579046435011037772) /
        (((((((r * 2.04426310338993978564e-15 + 1.4215117583164458887e-7) * r + 1.8463183175100546818e-5) *
                 r +
             7.868691311456132591e-4) *
                r +
            0.0148753612908506148525) *
               r +
           0.13692988092273580531) *
              r +
          0.59983220655588793769) *
             r +
         1);
  }
  return q < 0 ? -value : value;
}

}  // namespace atomcam::math
