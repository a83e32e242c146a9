#include "diagnosis/rivals.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/quantile.hpp"

namespace atomcam {

StacksLaw::StacksLaw(const Eigen::VectorXd& of_stacks, double least) {
  const std::vector<double> sample(of_stacks.data(), of_stacks.data() + of_stacks.size());
  middle_ = median(sample);
  spread_ = std::max(least, (quantile(sample, 0.84) - quantile(sample, 0.16)) / 2);
}

double StacksLaw::log_density(double value) const {
  constexpr double freedom = 6;
  const double z = (value - middle_) / spread_;
  return -0.5 * (freedom + 1) * std::log1p(z * z / freedom) - std::log(spread_);
}

namespace {

constexpr double least_ratio = 1;  // spread of a logarithm

}  // namespace

Rivals::Rivals(const Model& one, const Model& other)
    : one_(one),
      other_(other),
      of_one_(own_log_likelihoods(one) - log_likelihoods(other, one.population.whole), least_ratio),
      of_other_(log_likelihoods(one, other.population.whole) - own_log_likelihoods(other), least_ratio) {}

double Rivals::ratio(const Eigen::VectorXd& statistics) const {
  return log_likelihoods(one_, statistics.transpose())(0) -
         log_likelihoods(other_, statistics.transpose())(0);
}

double Rivals::odds(const Eigen::VectorXd& statistics) const {
  const double of_stack = ratio(statistics);
  return of_one_.log_density(of_stack) - of_other_.log_density(of_stack);
}

double discriminant_odds(const Model& one, const Model& other, const Eigen::VectorXd& statistics) {
  const Standard& standard = *other.standard;
  const Eigen::MatrixXd of_other = compressed_rows(tolerated_own(other));
  const Eigen::MatrixXd of_one = compressed_deviations(standard, one.population.whole).transpose();
  const auto scatter = [](const Eigen::MatrixXd& stacks) -> Eigen::RowVectorXd {  // of the mean, squared
    const double count = static_cast<double>(stacks.rows());
    return (stacks.rowwise() - stacks.colwise().mean()).colwise().squaredNorm() / (count * (count - 1));
  };
  const Eigen::VectorXd chance = 2 * (scatter(of_one) + scatter(of_other)).cwiseSqrt().transpose();
  const Eigen::VectorXd way =
      (of_one.colwise().mean() - of_other.colwise().mean()).transpose().binaryExpr(chance, &beyond_chance);
  if (way.isZero()) return 0;
  const Eigen::VectorXd filter = other.correlation->weighed(way).col(0);
  constexpr double least = 0.1;  // of the deviation that the correlations tell
  const double finest = least * std::sqrt(way.dot(filter));
  const double at = compressed_deviations(standard, statistics.transpose()).col(0).dot(filter);
  return StacksLaw(of_one * filter, finest).log_density(at) -
         StacksLaw(of_other * filter, finest).log_density(at);
}

}  // namespace atomcam
