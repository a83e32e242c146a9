#include "calibration/count_start.hpp"

#include <algorithm>

namespace atomcam {
namespace {

constexpr double least_noise = 0.4;  // counts: less is hidden by their being whole numbers

}  // namespace

CountStart count_start(const std::vector<std::uint64_t>& occurrences, double noted_noise) {
  std::size_t mode = 0;
  double best = -1;
  for (std::size_t c = 0; c < occurrences.size(); ++c) {
    double near = 0;
    for (std::size_t k = c >= 1 ? c - 1 : 0; k <= std::min<std::size_t>(c + 1, 65535); ++k)
      near += static_cast<double>(occurrences[k]);
    if (near > best) best = near, mode = c;
  }
  CountStart start{static_cast<double>(mode), std::max(noted_noise, least_noise)};
  // 68.27 % of what lies below the mode lies within one sigma of it.
  double below = 0;
  for (std::size_t c = 0; c < mode; ++c) below += static_cast<double>(occurrences[c]);
  below += 0.5 * static_cast<double>(occurrences[mode]);
  double sum = 0.5 * static_cast<double>(occurrences[mode]);
  for (std::size_t c = mode; c-- > 0;) {
    const double next = sum + static_cast<double>(occurrences[c]);
    if (next >= 0.6827 * below) {
      const double part = (0.6827 * below - sum) / std::max(1.0, next - sum);
      start.read_noise_counts = std::max(least_noise, static_cast<double>(mode - c) - 0.5 + part);
      break;
    }
    sum = next;
  }
  return start;
}

CountHistogram histogram_about(const std::vector<std::uint64_t>& occurrences, const CountStart& start,
                               double counts_per_electron) {
  const auto [bias, noise] = start;
  CountHistogram histogram;
  const double reach = std::max(12.0, 14 * counts_per_electron);
  const int last_seen = [&] {
    int last = 0;
    for (int c = 0; c < 65536; ++c)
      if (occurrences[static_cast<std::size_t>(c)]) last = c;
    return last;
  }();
  histogram.first = std::max(0, static_cast<int>(bias - 9 * noise));
  const int last = std::min(std::max(static_cast<int>(bias + 9 * noise), last_seen),
                            static_cast<int>(bias + 9 * noise + reach));
  for (int c = histogram.first; c <= std::min(last, 65535); ++c)
    histogram.occurrences.push_back(occurrences[static_cast<std::size_t>(c)]);
  return histogram;
}

}  // namespace atomcam
