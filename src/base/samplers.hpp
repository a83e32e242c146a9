#pragma once
// Samplers over a RandomStream, one draw at a time. Each states its law and its method; tests hold each
// against the law (chi-square, Kolmogorov-Smirnov). Bulk draws of the sensor's fast path stand in src/sensor.

#include <cstdint>
#include <vector>

#include "base/random.hpp"

namespace atomcam {

/// Standard normal law: quantile of one uniform number (Wichura's AS 241).
double sample_normal(RandomStream& random);
/// Exponential law of mean 1.
double sample_exponential(RandomStream& random);
/// Poisson law of mean `lambda` >= 0 (0 gives 0): inversion below 10, Hoermann's PTRS above (1993).
std::int64_t sample_poisson(RandomStream& random, double lambda);
/// Gamma law of shape `alpha` > 0, scale 1 (Marsaglia and Tsang 2000; boost by u^(1/alpha) below 1).
double sample_gamma(RandomStream& random, double alpha);
/// Binomial law (n >= 0, 0 <= p <= 1): inversion for n min(p, 1 - p) < 10, Hoermann's BTRS above.
std::int64_t sample_binomial(RandomStream& random, std::int64_t n, double p);
/// The same draws for many n at one p, from a table.
class BinomialLaw {
 public:
  explicit BinomialLaw(double p);
  std::int64_t operator()(RandomStream& random, std::int64_t n) const;

 private:
  double p_;
  std::vector<double> none_;  // probability of 0 of n, for the smaller of p and 1 - p
};
/// Gumbel law of mean 0 and scale `beta` (paper, section "Gumbel Distribution"): location -beta *
/// euler_gamma.
double sample_gumbel(RandomStream& random, double beta);

}  // namespace atomcam
