#pragma once
// Statistics of the tests: a law is accepted unless chance would do as badly less than once in a million
// times.

#include <algorithm>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <vector>

namespace atomcam::statistics {

inline constexpr double level = 1e-6;

struct Moments {
  double count = 0, mean = 0, m2 = 0, m3 = 0, m4 = 0;  // central, about the mean

  double variance() const { return m2; }
  double mean_error() const { return std::sqrt(m2 / count); }
  double variance_error() const { return std::sqrt(std::max(m4 - m2 * m2, 0.0) / count); }
};

template <class Values>
Moments moments(const Values& values) {
  Moments m;
  for (const auto v : values) m.mean += static_cast<double>(v);
  m.count = static_cast<double>(std::size(values));
  m.mean /= m.count;
  for (const auto v : values) {
    const double d = static_cast<double>(v) - m.mean;
    m.m2 += d * d;
    m.m3 += d * d * d;
    m.m4 += d * d * d * d;
  }
  m.m2 /= m.count;
  m.m3 /= m.count;
  m.m4 /= m.count;
  return m;
}

/// Probability of a chi-square at least this large, for counts of a law with the given cell probabilities.
/// Neighbouring cells are joined until each expects ten; what the probabilities leave over to 1 is the last
/// cell.
inline double chi_square_p(std::span<const double> observed, std::span<const double> probability,
                           double total) {
  double chi = 0, expected = 0, seen = 0, expected_sum = 0, seen_sum = 0;
  int cells = 0;
  const auto close = [&] {
    chi += (seen - expected) * (seen - expected) / expected;
    expected = seen = 0;
    ++cells;
  };
  for (std::size_t i = 0; i < probability.size(); ++i) {
    expected += probability[i] * total;
    seen += observed[i];
    expected_sum += probability[i] * total;
    seen_sum += observed[i];
    if (expected >= 10 && total - expected_sum >= 10) close();
  }
  expected += total - expected_sum;
  seen += total - seen_sum;
  if (expected > 0) close();
  if (cells < 2) return seen_sum == total ? 1 : 0;
  return boost::math::gamma_q((cells - 1) / 2.0, chi / 2);
}

/// The same for integer draws and a probability mass function on first, first + 1, ...
template <class Values>
double chi_square_p(const Values& draws, std::int64_t first, std::span<const double> mass) {
  std::vector<double> observed(mass.size(), 0.0);
  double total = 0;
  for (const auto draw : draws) {
    const std::int64_t i = static_cast<std::int64_t>(draw) - first;
    if (i < 0) return 0;  // outside the law's support
    if (i < static_cast<std::int64_t>(mass.size())) observed[static_cast<std::size_t>(i)] += 1;
    total += 1;
  }
  return chi_square_p(observed, mass, total);
}

/// Probability of a Kolmogorov-Smirnov distance at least this large, for a continuous law.
inline double kolmogorov_p(std::vector<double> values, const std::function<double(double)>& cumulative) {
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  double distance = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double f = cumulative(values[i]);
    distance = std::max({distance, f - static_cast<double>(i) / n, static_cast<double>(i + 1) / n - f});
  }
  const double x = (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n)) * distance;
  double p = 0;
  for (int k = 1; k <= 100; ++k) p += (k % 2 == 1 ? 2 : -2) * std::exp(-2.0 * k * k * x * x);
  return std::clamp(x < 0.2 ? 1.0 : p, 0.0, 1.0);
}

/// (observed - expected) in standard errors.
inline double sigmas(double observed, double expected, double standard_error) {
  return std::fabs(observed - expected) / standard_error;
}

inline double correlation(std::span<const double> a, std::span<const double> b) {
  const Moments ma = moments(a), mb = moments(b);
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - ma.mean) * (b[i] - mb.mean);
  return sum / ma.count / std::sqrt(ma.m2 * mb.m2);
}

}  // namespace atomcam::statistics
