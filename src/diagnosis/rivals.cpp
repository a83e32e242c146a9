#include "diagnosis/rivals.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/quantile.hpp"

namespace atomcam {

Rivals::Law::Law(const Eigen::VectorXd& ratios) {
  constexpr double least = 1;  // a logarithm: finer than this nothing is known
  const std::vector<double> sample(ratios.data(), ratios.data() + ratios.size());
  middle = median(sample);
  spread = std::max(least, (quantile(sample, 0.84) - quantile(sample, 0.16)) / 2);
}

/// Student's law: real frames are of neither model to all digits.
double Rivals::Law::log_density(double ratio) const {
  constexpr double freedom = 6;
  const double z = (ratio - middle) / spread;
  return -0.5 * (freedom + 1) * std::log1p(z * z / freedom) - std::log(spread);
}

Rivals::Rivals(const Model& one, const Model& other)
    : one_(one),
      other_(other),
      of_one_(own_log_likelihoods(one) - log_likelihoods(other, one.population.whole)),
      of_other_(log_likelihoods(one, other.population.whole) - own_log_likelihoods(other)) {}

double Rivals::ratio(const Eigen::VectorXd& statistics) const {
  return log_likelihoods(one_, statistics.transpose())(0) -
         log_likelihoods(other_, statistics.transpose())(0);
}

double Rivals::odds(const Eigen::VectorXd& statistics) const {
  const double of_stack = ratio(statistics);
  return of_one_.log_density(of_stack) - of_other_.log_density(of_stack);
}

}  // namespace atomcam
