#include "analysis/distortion.hpp"

#include <cmath>
#include <numeric>
#include <vector>

#include "analysis/sheet.hpp"

namespace atomcam::analysis {
namespace {

double product(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

/// Takes out of `from` what points along the unit vector `part`; returns its square.
double taken_out(std::vector<double>& from, std::span<const double> part) {
  const double share = product(from, part);
  for (std::size_t s = 0; s < from.size(); ++s) from[s] -= share * part[s];
  return share * share;
}

}  // namespace

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
      const double size = product(term, term);
      for (const std::vector<double>& before : basis) taken_out(term, before);
      const double own = product(term, term);
      if (own < 1e-9 * size) continue;  // a grid of three columns knows of no third order
      for (double& value : term) value /= std::sqrt(own);
      const double square = taken_out(rest, term);
      if (degree > 1) smooth += square, ++used;
      basis.push_back(std::move(term));
    }
  const double freedom = static_cast<double>(sites) - static_cast<double>(basis.size());
  return used > 0 ? std::log((smooth / used + 1e-12) / (product(rest, rest) / freedom + 1e-12))
                  : not_a_number;
}

}  // namespace atomcam::analysis
