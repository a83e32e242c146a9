#pragma once
// Asking a list of deviations for those of some statistics.

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include <Eigen/Dense>
#include "analysis/battery.hpp"

namespace atomcam {

/// Whether the statistic's name contains this.
inline bool has(const StatisticDeclaration& one, std::string_view part) {
  return one.name.find(part) != std::string::npos;
}

/// The deviation of the statistic of this name, with its sign; 0 if there is none.
inline double deviation_of(std::string_view name, const std::vector<StatisticDeclaration>& battery,
                           const Eigen::VectorXd& z) {
  for (std::size_t k = 0; k < battery.size(); ++k)
    if (battery[k].name == name) return z(static_cast<Eigen::Index>(k));
  return 0;
}

/// The largest deviation of the statistics for which `counts` says so.
template <class Counts>
double largest(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
               const Counts& counts) {
  double most = 0;
  for (std::size_t k = 0; k < battery.size(); ++k)
    if (counts(battery[k])) most = std::max(most, std::fabs(z(static_cast<Eigen::Index>(k))));
  return most;
}

}  // namespace atomcam
