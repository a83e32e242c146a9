#include "analysis/law_bands.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace atomcam::analysis {
namespace {

constexpr double least_probability = 5e-5;  // of a bin: tens of pixels in a usual stack

struct Band {
  std::string_view name;
  double read_noises, gains;  // where it ends, above the bias: so many of either
};
constexpr std::array<Band, 12> bands = {{{"far_below", -1.5, 0},
                                         {"below", -0.5, 0},
                                         {"bias", 0.5, 0},
                                         {"above", 1.5, 0},
                                         {"to_2.5_read_noises", 2.5, 0},
                                         {"to_3.5_read_noises", 3.5, 0},
                                         {"to_5_read_noises", 5, 0},
                                         {"to_0.7_gains", 5, 0.7},
                                         {"to_1.5_gains", 5, 1.5},
                                         {"to_3_gains", 5, 3},
                                         {"to_5_gains", 5, 5},
                                         {"tail", 5, 1e9}}};

double product(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}
/// Leaves nothing along a direction of length one.
void take_out(const std::vector<double>& direction, std::vector<double>& from) {
  const double along = product(direction, from);
  for (std::size_t b = 0; b < from.size(); ++b) from[b] -= along * direction[b];
}

}  // namespace

LawBands::LawBands(const Layout& layout) : expected_(layout.expected) {
  const std::size_t size = expected_.probability.size();
  if (size == 0) return;
  const double bias = static_cast<double>(layout.bias), read = static_cast<double>(layout.read_noise),
               gain = static_cast<double>(layout.counts_per_e);
  const auto band_of = [&](int code) {
    std::size_t band = 0;
    while (band + 1 < bands.size() && code > bias + bands[band].read_noises * read + bands[band].gains * gain)
      ++band;
    return band;
  };
  // A direction's change from one place of the law to another.
  const auto change = [](const std::vector<double>& direction, std::size_t from, std::size_t to) {
    return std::accumulate(direction.begin() + static_cast<std::ptrdiff_t>(from),
                           direction.begin() + static_cast<std::ptrdiff_t>(to), 0.0);
  };
  std::vector<std::vector<double>> slopes(expected_.directions.size());
  std::size_t from = 0;
  double probability = 0;
  for (std::size_t k = 0; k < size; ++k) {
    probability += expected_.probability[k];
    if (probability < least_probability) continue;
    const int code = expected_.first + static_cast<int>(k);
    bins_.push_back({code + 1, probability, band_of(code)});
    for (std::size_t d = 0; d < slopes.size(); ++d)
      slopes[d].push_back(change(expected_.directions[d], from, k + 1));
    from = k + 1;
    probability = 0;
  }
  if (bins_.empty()) return;
  // The last bin holds all that lies beyond.
  bins_.back().end = std::numeric_limits<int>::max();
  bins_.back().probability += probability;
  for (std::size_t d = 0; d < slopes.size(); ++d) {
    std::vector<double>& direction = slopes[d];
    direction.back() += change(expected_.directions[d], from, size);
    for (std::size_t b = 0; b < bins_.size(); ++b) direction[b] /= std::sqrt(bins_[b].probability);
    const double before = std::sqrt(product(direction, direction));
    for (const std::vector<double>& other : basis_) take_out(other, direction);
    const double length = std::sqrt(product(direction, direction));
    if (!(length > 1e-6 * before)) continue;
    for (double& value : direction) value /= length;
    basis_.push_back(direction);
  }
}

void LawBands::put(std::span<const double> below, int first, Sheet& sheet) const {
  if (bins_.empty()) return;
  const double total = below.back();
  const auto number_below = [&](int code) {
    return below[static_cast<std::size_t>(
        std::clamp<std::int64_t>(std::int64_t{code} - first, 0, std::ssize(below) - 1))];
  };
  std::vector<double> off;
  double counted = 0;
  for (const Bin& bin : bins_) {
    const double expected = total * bin.probability, upto = number_below(bin.end);
    off.push_back((upto - counted - expected) / std::sqrt(std::max(expected, 1e-9)));
    counted = upto;
  }
  for (const std::vector<double>& direction : basis_) take_out(direction, off);
  std::array<double, bands.size()> sum{}, probability{};
  double square = 0;
  for (std::size_t b = 0; b < bins_.size(); ++b) {
    sum[bins_[b].band] += off[b] * std::sqrt(bins_[b].probability);
    probability[bins_[b].band] += bins_[b].probability;
    square += off[b] * off[b];
  }
  for (std::size_t band = 0; band < bands.size(); ++band)
    sheet.put("law", bands[band].name,
              total > 0 && probability[band] > 0 ? sum[band] / std::sqrt(probability[band]) : not_a_number);
  const auto free = static_cast<double>(std::max<std::size_t>(1, bins_.size() - basis_.size()));
  sheet.put("law", "misfit", total > 0 ? std::log(square / free) : not_a_number);
}

}  // namespace atomcam::analysis
