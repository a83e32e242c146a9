#include "calibration/line_pattern.hpp"

#include <algorithm>
#include <cmath>

namespace atomcam {

std::optional<LinePattern> wide_line_pattern(const StackSums& sums) {
  const int rows = sums.sum.rows(), columns = sums.sum.columns();
  LinePattern pattern;
  pattern.rows.assign(static_cast<std::size_t>(rows), 0);
  pattern.columns.assign(static_cast<std::size_t>(columns), 0);
  double mean = 0;
  for (std::size_t i = 0; i < sums.sum.pixels().size(); ++i) {
    const double value = sums.mean(i);
    pattern.rows[i / static_cast<std::size_t>(columns)] += value / columns;
    pattern.columns[i % static_cast<std::size_t>(columns)] += value / rows;
    mean += value / rows / columns;
  }
  double square = 0;
  for (double& row : pattern.rows) row -= mean, square += row * row / rows;
  for (double& column : pattern.columns) column -= mean, square += column * column / columns;
  pattern.sigma_counts = std::sqrt(square);
  if (!(square > sums.median_variance())) return std::nullopt;
  return pattern;
}

std::vector<std::uint64_t> occurrences_without(const LinePattern& pattern, const FrameSequence& frames) {
  constexpr int largest = 65535;
  std::vector<std::uint64_t> occurrences(largest + 1, 0);
  frames.visit([&](std::size_t, const CountImage& frame) {
    for (int row = 0; row < frame.rows(); ++row)
      for (int column = 0; column < frame.columns(); ++column) {
        const double level =
            pattern.rows[static_cast<std::size_t>(row)] + pattern.columns[static_cast<std::size_t>(column)];
        const auto count = static_cast<int>(frame(row, column)) - static_cast<int>(std::lround(level));
        ++occurrences[static_cast<std::size_t>(std::clamp(count, 0, largest))];
      }
  });
  return occurrences;
}

}  // namespace atomcam
