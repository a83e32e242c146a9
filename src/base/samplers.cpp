#include "base/samplers.hpp"

#include <algorithm>
#include <cmath>

#include "base/math.hpp"

namespace atomcam {

double sample_normal(RandomStream& random) {
  return math::normal_quantile(random.uniform53());
}

double sample_exponential(RandomStream& random) {
  return -math::log(random.uniform53());
}

std::int64_t sample_poisson(RandomStream& random, double lambda) {
  if (!(lambda > 0)) return 0;
  if (lambda < 10) {
    double p = math::exp(-lambda), u = random.uniform53();
    std::int64_t k = 0;
    while (u > p && k < 200) {
      u -= p;
      ++k;
      p *= lambda / static_cast<double>(k);
    }
    return k;
  }
  // W. Hoermann, "The transformed rejection method for generating Poisson random variables", 1993: PTRS.
  const double log_lambda = math::log(lambda);
  const double b = 0.931 + 2.53 * std::sqrt(lambda);
  const double a = -0.059 + 0.02483 * b;
  const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
  const double v_r = 0.9277 - 3.6224 / (b - 2);
  while (true) {
    const double u = random.uniform53() - 0.5;
    const double v = random.uniform53();
    const double us = 0.5 - std::fabs(u);
    const double k = std::floor((2 * a / us + b) * u + lambda + 0.43);
    if (us >= 0.07 && v <= v_r) return static_cast<std::int64_t>(k);
    if (k < 0 || (us < 0.013 && v > us)) continue;
    if (math::log(v * inverse_alpha / (a / (us * us) + b)) <=
        k * log_lambda - lambda - math::log_gamma(k + 1))
      return static_cast<std::int64_t>(k);
  }
}

double sample_gamma(RandomStream& random, double alpha) {
  if (alpha < 1) {
    const double boost = math::pow(random.uniform53(), 1 / alpha);
    return boost * sample_gamma(random, alpha + 1);
  }
  const double d = alpha - 1.0 / 3, c = 1 / std::sqrt(9 * d);
  while (true) {
    const double z = sample_normal(random);
    const double t = 1 + c * z;
    if (t <= 0) continue;
    const double v = t * t * t;
    const double u = random.uniform53(), q = z * z;
    if (u < 1 - 0.0331 * q * q)
      return d * v;  // the authors' squeeze: below the exact bound, without logarithms
    if (math::log(u) < 0.5 * q + d - d * v + d * math::log(v)) return d * v;
  }
}

namespace {

/// Probability that none of n happens.
double binomial_none(std::int64_t n, double p) {
  return math::exp(static_cast<double>(n) * math::log(1 - p));
}

std::int64_t invert_binomial(RandomStream& random, std::int64_t n, double p, double none) {
  const double odds = p / (1 - p);
  double probability = none, u = random.uniform53();
  std::int64_t k = 0;
  while (u > probability && k < n) {
    u -= probability;
    ++k;
    probability *= odds * static_cast<double>(n - k + 1) / static_cast<double>(k);
  }
  return k;
}

}  // namespace

BinomialLaw::BinomialLaw(double p) : p_(p) {
  const double smaller = std::min(p, 1 - p);
  if (!(smaller > 0)) return;
  const auto entries = static_cast<std::size_t>(std::min(1024.0, std::ceil(10 / smaller)));
  for (std::size_t n = 0; n < entries; ++n)
    none_.push_back(binomial_none(static_cast<std::int64_t>(n), smaller));
}

std::int64_t BinomialLaw::operator()(RandomStream& random, std::int64_t n) const {
  if (n <= 0 || static_cast<std::size_t>(n) >= none_.size()) return sample_binomial(random, n, p_);
  const double none = none_[static_cast<std::size_t>(n)];
  return p_ > 0.5 ? n - invert_binomial(random, n, 1 - p_, none) : invert_binomial(random, n, p_, none);
}

std::int64_t sample_binomial(RandomStream& random, std::int64_t n, double p) {
  if (n <= 0 || !(p > 0)) return 0;
  if (p >= 1) return n;
  if (p > 0.5) return n - sample_binomial(random, n, 1 - p);
  const double q = 1 - p, count = static_cast<double>(n);
  if (count * p < 10) return invert_binomial(random, n, p, binomial_none(n, p));
  // W. Hoermann, "The generation of binomial random variates", 1993: BTRS.
  const double spread = std::sqrt(count * p * q);
  const double b = 1.15 + 2.53 * spread;
  const double a = -0.0873 + 0.0248 * b + 0.01 * p;
  const double center = count * p + 0.5;
  const double v_r = 0.92 - 4.2 / b;
  const double alpha = (2.83 + 5.1 / b) * spread;
  const double log_odds = math::log(p / q);
  const double mode = std::floor((count + 1) * p);
  const double h = math::log_gamma(mode + 1) + math::log_gamma(count - mode + 1);
  while (true) {
    const double u = random.uniform53() - 0.5;
    double v = random.uniform53();
    const double us = 0.5 - std::fabs(u);
    const double k = std::floor((2 * a / us + b) * u + center);
    if (k < 0 || k > count) continue;
    if (us >= 0.07 && v <= v_r) return static_cast<std::int64_t>(k);
    v = math::log(v * alpha / (a / (us * us) + b));
    if (v <= h - math::log_gamma(k + 1) - math::log_gamma(count - k + 1) + (k - mode) * log_odds)
      return static_cast<std::int64_t>(k);
  }
}

double sample_gumbel(RandomStream& random, double beta) {
  return -beta * (math::euler_gamma + math::log(-math::log(random.uniform53())));
}

}  // namespace atomcam
