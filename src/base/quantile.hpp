#pragma once
// Quantiles of a few values: the one nearest in rank, no interpolation.

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace atomcam {

/// 0 if there are no values.
inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  const auto n = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + n, values.end());
  return values[static_cast<std::size_t>(n)];
}
inline double median(std::vector<double> values) {
  return quantile(std::move(values), 0.5);
}

}  // namespace atomcam
