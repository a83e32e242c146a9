#include "analysis/spectrum_shapes.hpp"

#include <algorithm>

namespace atomcam::analysis {

void put_spectrum(Sheet& sheet, std::span<const float> power, int rows, int columns) {
  const auto half = static_cast<std::size_t>(columns / 2 + 1);
  float along_row = 0, along_column = 0, oblique = 0;
  double sum = 0, low = 0, high = 0, count = 0, low_count = 0, high_count = 0;
  for (int u = 0; u < rows; ++u) {
    const int fu = std::min(u, rows - u);
    const float* line = power.data() + static_cast<std::size_t>(u) * half;
    if (fu == 0) {
      for (std::size_t v = 1; v < half; ++v) along_row = std::max(along_row, line[v]);
      continue;
    }
    along_column = std::max(along_column, line[0]);
    float top = 0;
    double line_sum = 0;
    for (std::size_t v = 1; v < half; ++v)
      top = std::max(top, line[v]), line_sum += static_cast<double>(line[v]);
    oblique = std::max(oblique, top);
    sum += line_sum;
    count += static_cast<double>(half - 1);
    if (fu <= 4)
      for (std::size_t v = 1; v < std::min<std::size_t>(half, 5); ++v)
        low += static_cast<double>(line[v]), ++low_count;
    if (4 * fu > rows)
      for (std::size_t v = half / 2; v < half; ++v) high += static_cast<double>(line[v]), ++high_count;
  }
  const double mean = sum / count;
  const bool any = sum > 0;
  const auto over_mean = [&](double value) { return any ? std::log(value / mean + 1e-6) : not_a_number; };
  sheet.put_unsteady("peak_along_rows", over_mean(static_cast<double>(along_row)));
  sheet.put_unsteady("peak_along_columns", over_mean(static_cast<double>(along_column)));
  sheet.put_unsteady("peak_oblique", over_mean(static_cast<double>(oblique)));
  sheet.put("low", over_mean(low / std::max(low_count, 1.0)));
  sheet.put("high", over_mean(high / std::max(high_count, 1.0)));
}

}  // namespace atomcam::analysis
