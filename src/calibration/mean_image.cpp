#include "calibration/mean_image.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/quantile.hpp"

namespace atomcam {

MeanImage mean_image(const StackSums& light, std::span<const double> dark_counts, double counts_per_electron,
                     double excess, double dark_variance_e2) {
  MeanImage mean;
  mean.electrons = Image<double, unit::electrons>(light.sum.shape());
  mean.variance = mean.dark_variance = Image<double, unit::electrons>(light.sum.shape());
  const double n = static_cast<double>(light.frames);
  const std::size_t pixels = light.sum.pixels().size();
  mean.variance_per_e = excess / n;
  for (std::size_t i = 0; i < pixels; ++i)
    mean.electrons.pixels()[i] = (light.mean(i) - dark_counts[i]) / counts_per_electron;
  // Shot noise from the image smoothed a little, so that a low pixel does not weigh more for being low.
  const int rows = mean.electrons.rows(), columns = mean.electrons.columns();
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      double sum = 0, count = 0;
      for (int v = std::max(0, y - 1); v <= std::min(rows - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(columns - 1, x + 1); ++u)
          sum += mean.electrons(v, u), count += 1;
      const double around = std::max({0.0, sum / count, mean.electrons(y, x)});
      mean.dark_variance(y, x) = dark_variance_e2 + 1e-12;
      mean.variance(y, x) = dark_variance_e2 + mean.variance_per_e * around + 1e-12;
    }
  // What stands out from its neighbourhood as no image of a point can (hot pixels) is given no weight.
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      double highest = -1e300;
      for (int v = std::max(0, y - 1); v <= std::min(rows - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(columns - 1, x + 1); ++u)
          if (u != x || v != y) highest = std::max(highest, mean.electrons(v, u));
      const double value = mean.electrons(y, x);
      if (value - std::max(highest, 0.0) > 4 * std::max(highest, 0.0) + 12 * std::sqrt(mean.variance(y, x)))
        mean.variance(y, x) = 1e12;
    }
  // Nor what lies below the dark parts of the image: no light does that, and with hardly any noise of its
  // own it would weigh more than the sites.
  const auto values = mean.electrons.pixels();
  const double dark = quantile(std::vector<double>(values.begin(), values.end()), 0.1);
  for (std::size_t i = 0; i < pixels; ++i)
    if (mean.electrons.pixels()[i] < dark - 12 * std::sqrt(mean.dark_variance.pixels()[i]))
      mean.variance.pixels()[i] = 1e12;
  return mean;
}

}  // namespace atomcam
