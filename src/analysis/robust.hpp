#pragma once
// Spread without outliers.

#include <cmath>
#include <vector>

namespace atomcam::analysis {

/// Standard deviation of the values (their mean taken to be zero) with those beyond 2.5 of it left out,
/// corrected for a normal law.
inline double core_spread(const std::vector<float>& values) {
  if (values.empty()) return std::nan("");
  float limit = 1e30f;
  double spread = 0;
  for (int round = 0; round < 6; ++round) {
    float lanes[16] = {};
    float counts[16] = {};
    const std::size_t whole = values.size() / 16 * 16;
    for (std::size_t i = 0; i < whole; i += 16)
      for (std::size_t l = 0; l < 16; ++l) {
        const float v = values[i + l] * values[i + l];
        lanes[l] += v < limit ? v : 0.0f;
        counts[l] += v < limit ? 1.0f : 0.0f;
      }
    double sum = 0, count = 0;
    for (std::size_t l = 0; l < 16; ++l)
      sum += static_cast<double>(lanes[l]), count += static_cast<double>(counts[l]);
    for (std::size_t i = whole; i < values.size(); ++i)
      if (const float v = values[i] * values[i]; v < limit) sum += static_cast<double>(v), count += 1;
    // Variance of a normal law cut at 2.5 of its standard deviations.
    constexpr double kept = 0.9112;
    const double before = spread;
    spread = std::sqrt(sum / std::max(count, 1.0) / (round == 0 ? 1 : kept));
    limit = static_cast<float>(6.25 * spread * spread);
    if (round > 0 && std::abs(spread - before) < 1e-3 * spread) break;
  }
  return spread;
}

/// How far values stand out: sums of the squared excess over three of their spread, above and below. Steady
/// where a number of outliers would jump.
struct Outliers {
  double above = 0, below = 0, highest = 0, lowest = 0;
  void take(double z) {
    const double over = z > 3 ? z - 3 : 0, under = z < -3 ? z + 3 : 0;
    above += over * over;
    below += under * under;
    highest = z > highest ? z : highest;
    lowest = z < lowest ? z : lowest;
  }
};

}  // namespace atomcam::analysis
