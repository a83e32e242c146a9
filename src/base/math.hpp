#pragma once
// Elementary functions of the frame path. A C library's last bits differ between versions and processors;
// these are plain IEEE-754 arithmetic (no contraction), so a frame has the same bits everywhere. sqrt, floor
// and the four operations are exact by the standard and are used as they are.

namespace atomcam::math {

/// Natural logarithm, x > 0 and normal; relative error below 1e-15.
double log(double x);
/// e^x; relative error below 1e-15; 0 below -708, +inf above 709.
double exp(double x);
/// sin(2 pi x) and cos(2 pi x) of a number of turns; absolute error below 1e-15 for |x| < 2^40.
double sin_turns(double x);
double cos_turns(double x);
/// x^y for x > 0.
inline double pow(double x, double y) {
  return exp(y * log(x));
}
/// ln Gamma(x), x > 0; absolute error below 1e-12 * max(1, |value|).
double log_gamma(double x);
/// Quantile of the standard normal law, 0 < p < 1 (Wichura, AS 241, PPND16: relative error about 1e-16).
double normal_quantile(double p);

inline constexpr double pi = 3.14159265358979323846;
inline constexpr double euler_gamma = 0.57721566490153286061;

}  // namespace atomcam::math
