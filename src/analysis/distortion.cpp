#include "analysis/distortion.hpp"

#include <cmath>
#include <vector>

#include "analysis/sheet.hpp"

namespace atomcam::analysis {

double log_distortion(std::span<const double> x, std::span<const double> y, std::span<const double> w,
                      std::span<const double> d) {
  constexpr int order = 3, terms = (order + 1) * (order + 2) / 2;
  const std::size_t sites = d.size();
  if (sites < 2 * terms) return not_a_number;
  std::vector<double> rest(sites);
  for (std::size_t s = 0; s < sites; ++s) rest[s] = d[s] * std::sqrt(w[s]);
  double smooth = 0, used = 0;
  std::vector<std::vector<double>> basis;
  for (int degree = 0; degree <= order; ++degree)
    for (int k = 0; k <= degree; ++k) {
      std::vector<double> term(sites);
      for (std::size_t s = 0; s < sites; ++s)
        term[s] = std::pow(x[s], degree - k) * std::pow(y[s], k) * std::sqrt(w[s]);
      const auto product = [&](std::span<const double> a, std::span<const double> b) {
        double sum = 0;
        for (std::size_t s = 0; s < sites; ++s) sum += a[s] * b[s];
        return sum;
      };
      const auto without = [&](std::vector<double>& from, std::span<const double> part) {
        const double share = product(from, part);
        for (std::size_t s = 0; s < sites; ++s) from[s] -= share * part[s];
        return share * share;
      };
      const double size = product(term, term);
      for (std::span<const double> before : basis) without(term, before);
      const double own = product(term, term);
      if (own < 1e-9 * size) continue;  // a grid of three columns knows of no third order
      for (double& value : term) value /= std::sqrt(own);
      const double square = without(rest, term);
      if (degree > 1) smooth += square, ++used;
      basis.push_back(std::move(term));
    }
  double left = 0;
  for (const double value : rest) left += value * value;
  const double freedom = static_cast<double>(sites) - static_cast<double>(basis.size());
  return used > 0 ? std::log((smooth / used + 1e-12) / (left / freedom + 1e-12)) : not_a_number;
}

}  // namespace atomcam::analysis
