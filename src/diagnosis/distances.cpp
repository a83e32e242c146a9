#include "diagnosis/distances.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace atomcam {
namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

double total_of(std::span<const std::uint64_t> histogram) {
  return static_cast<double>(std::accumulate(histogram.begin(), histogram.end(), std::uint64_t{0}));
}

}  // namespace

double wasserstein(std::span<const std::uint64_t> one, std::span<const std::uint64_t> two) {
  const double of_one = total_of(one), of_two = total_of(two);
  if (!(of_one > 0 && of_two > 0)) return nothing;
  double below_one = 0, below_two = 0, sum = 0;
  for (std::size_t k = 0; k < one.size(); ++k) {
    below_one += static_cast<double>(one[k]);
    below_two += static_cast<double>(two[k]);
    sum += std::fabs(below_one / of_one - below_two / of_two);
  }
  return sum;
}

double wasserstein_of_samples(std::vector<float> one, std::vector<float> two) {
  if (one.empty() || two.empty()) return nothing;
  std::sort(one.begin(), one.end());
  std::sort(two.begin(), two.end());
  // The distance between the distribution functions, from sample to sample of either.
  double sum = 0;
  std::size_t i = 0, j = 0;
  double at = static_cast<double>(std::min(one.front(), two.front()));
  while (i < one.size() || j < two.size()) {
    const bool first = j == two.size() || (i < one.size() && one[i] <= two[j]);
    const auto next = static_cast<double>(first ? one[i] : two[j]);
    sum += (next - at) * std::fabs(static_cast<double>(i) / static_cast<double>(one.size()) -
                                   static_cast<double>(j) / static_cast<double>(two.size()));
    at = next;
    ++(first ? i : j);
  }
  return sum;
}

std::vector<std::size_t> count_bins(std::span<const std::uint64_t> pool) {
  const double total = total_of(pool);
  std::vector<std::size_t> bins = {0};
  double below = 0, inside = 0;
  for (std::size_t count = 0; count + 1 < pool.size(); ++count) {
    inside += static_cast<double>(pool[count]);
    const double tail = std::min(below + inside, total - below - inside);
    if (inside < std::max(50.0, std::min(total / 256, tail / 4))) continue;
    if (total - below - inside < 50) break;
    bins.push_back(count + 1);
    below += inside;
    inside = 0;
  }
  return bins;
}

std::vector<std::uint64_t> binned(std::span<const std::uint64_t> occurrences,
                                  const std::vector<std::size_t>& bins) {
  std::vector<std::uint64_t> sums(bins.size(), 0);
  for (std::size_t k = 0; k < bins.size(); ++k) {
    const std::size_t end = k + 1 < bins.size() ? bins[k + 1] : occurrences.size();
    for (std::size_t count = bins[k]; count < end; ++count) sums[k] += occurrences[count];
  }
  return sums;
}

double divergence(std::span<const std::uint64_t> one, std::span<const std::uint64_t> two) {
  const auto bins = static_cast<double>(one.size());
  if (total_of(one) == 0 || total_of(two) == 0) return nothing;
  const double of_one = total_of(one) + 0.5 * bins, of_two = total_of(two) + 0.5 * bins;
  double sum = 0;
  for (std::size_t k = 0; k < one.size(); ++k) {
    const double p = (static_cast<double>(one[k]) + 0.5) / of_one,
                 q = (static_cast<double>(two[k]) + 0.5) / of_two;
    sum += (p - q) * std::log(p / q);
  }
  return 0.5 * sum;
}

}  // namespace atomcam
