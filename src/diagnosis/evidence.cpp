#include "diagnosis/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace atomcam {

Eigen::VectorXd compressed(const Eigen::VectorXd& z) {
  return z.unaryExpr([](double v) { return 2 * std::asinh(v / 2); });
}
Eigen::MatrixXd compressed_rows(const Eigen::MatrixXd& z) {
  return z.unaryExpr([](double v) { return 2 * std::asinh(v / 2); });
}

double beyond_chance(double value, double chance) {
  const double part = chance / std::max(1e-300, std::fabs(value));
  return part < 1 ? value * (1 - part * part) : 0;
}

double gap_of(const Eigen::VectorXd& z) {
  std::vector<double> squares(z.data(), z.data() + z.size());
  for (double& v : squares) v *= v;
  const std::size_t count = std::min<std::size_t>(12, squares.size());
  if (count == 0) return 0;
  std::partial_sort(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(count), squares.end(),
                    std::greater<>());
  double sum = 0;
  for (std::size_t k = 0; k < count; ++k) sum += squares[k];
  return sum / static_cast<double>(count);
}

Floor::Floor(const Eigen::MatrixXd& own, const Eigen::VectorXd& units) {
  for (Eigen::Index n = 0; n < own.rows(); ++n) {
    const Eigen::VectorXd z = own.row(n).transpose();
    sorted_.push_back(gap_of(units.size() ? Eigen::VectorXd(z.cwiseProduct(units)) : z));
  }
  std::sort(sorted_.begin(), sorted_.end());
}

double Floor::at(double quantile) const {
  if (sorted_.empty()) return 0;
  return sorted_[static_cast<std::size_t>(quantile * static_cast<double>(sorted_.size() - 1))];
}

Correlation::Correlation(const Eigen::MatrixXd& own) {
  const Eigen::MatrixXd y = compressed_rows(own);
  const double n = static_cast<double>(y.rows()), p = static_cast<double>(y.cols());
  // C = (n / (n + p)) y'y / n + (p / (n + p)) 1 = alone (1 + y'y / p)
  alone_ = p / (n + p);
  Eigen::MatrixXd gram = y * y.transpose();
  gram.diagonal().array() += p;
  const Eigen::LLT<Eigen::MatrixXd> factors(gram);
  together_ = factors.matrixL().solve(y);
  log_determinant_ = p * std::log(alone_) - n * std::log(p);
  for (Eigen::Index k = 0; k < gram.rows(); ++k) log_determinant_ += 2 * std::log(factors.matrixLLT()(k, k));
}

Eigen::MatrixXd Correlation::weighed(const Eigen::MatrixXd& columns) const {
  return (columns - together_.transpose() * (together_ * columns)) / alone_;
}

Eigen::VectorXd Correlation::squares(const Eigen::MatrixXd& columns) const {
  return (columns.colwise().squaredNorm() - (together_ * columns).colwise().squaredNorm()).transpose() /
         alone_;
}

std::vector<Correlation> correlations_without_each_fold(const Eigen::MatrixXd& own) {
  std::vector<Correlation> list;
  for (int fold = 0; fold < Standard::folds; ++fold) {
    std::vector<Eigen::Index> others;
    for (Eigen::Index n = 0; n < own.rows(); ++n)
      if (n % Standard::folds != fold) others.push_back(n);
    list.emplace_back(own(others, Eigen::all));
  }
  return list;
}

namespace {

// Mean excess of each view over the highest tenth of the plain model's stacks. Over two sensors, frames of 64
// and of 96 pixels and any set-points it varies no more than the chance of 24 stacks makes it; the views of
// |z| are exponential there.
constexpr std::array known_excess{0.43, 0.38, 0.083};
constexpr double worth = 60;  // stacks beyond the highest tenth
constexpr double excess_of_log_p = 1;

/// What makes the fourth moment of a statistic a normal law's, where it is beyond that.
Eigen::ArrayXd normal_fourth(const Eigen::ArrayXd& squares, const Eigen::ArrayXd& fourths, double stacks) {
  const Eigen::ArrayXd normal = 3 * squares.square() / stacks;
  return (fourths > normal).select((normal / fourths.max(1e-300)).sqrt().sqrt(), 1.0);
}

}  // namespace

OmnibusTest::OmnibusTest(const Eigen::MatrixXd& own, std::vector<bool> unsteady, Tails tails)
    : tails_(tails), unsteady_(std::move(unsteady)) {
  const bool all_labs = tails_ == Tails::of_all_labs;
  const auto known = [&](double excess) -> NullDistribution::KnownTail {
    return {excess, all_labs ? worth : 0};
  };
  const Eigen::ArrayXXd square = own.array().square();
  const Eigen::ArrayXd squares = square.colwise().sum().transpose(),
                       fourths = square.square().colwise().sum().transpose();
  const double stacks = static_cast<double>(own.rows());
  const auto weights = [&](const Eigen::ArrayXd& left_out, double count) -> Eigen::VectorXd {
    if (!all_labs) return Eigen::VectorXd::Ones(own.cols());
    return normal_fourth(squares - left_out, fourths - left_out.square(), count);
  };
  // Every stack is held against the others, as the real one is, and is weighed as they say.
  std::array<std::vector<double>, views> samples;
  for (Eigen::Index n = 0; n < own.rows(); ++n) {
    const Views seen = look(own.row(n).transpose(), weights(square.row(n).transpose(), stacks - 1));
    for (std::size_t k = 0; k < views; ++k) samples[k].push_back(seen[k]);
  }
  weights_ = weights(Eigen::ArrayXd::Zero(own.cols()), stacks);
  std::vector<double> smallest_p(samples.front().size(), 1);
  for (std::size_t k = 0; k < views; ++k)
    for (std::size_t n = 0; n < smallest_p.size(); ++n) {
      std::vector<double> others = samples[k];
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(n));
      const NullDistribution null(std::move(others), known(known_excess[k]));
      smallest_p[n] = std::min(smallest_p[n], null.p_value(samples[k][n]));
    }
  for (double& p : smallest_p) p = -std::log(p);
  for (std::size_t k = 0; k < views; ++k) nulls_.emplace_back(std::move(samples[k]), known(known_excess[k]));
  combined_.emplace(std::move(smallest_p), known(excess_of_log_p));
}

OmnibusTest::Views OmnibusTest::look(const Eigen::VectorXd& z, const Eigen::VectorXd& weights) const {
  const Eigen::VectorXd all = z.cwiseProduct(weights);
  Eigen::VectorXd steady = all;
  for (Eigen::Index i = 0; i < z.size(); ++i)
    if (const auto at = static_cast<std::size_t>(i); at < unsteady_.size() && unsteady_[at]) steady(i) = 0;
  const auto largest = [&](const Eigen::VectorXd& of) {
    const double most = of.size() ? of.cwiseAbs().maxCoeff() : 0;
    return tails_ == Tails::of_all_labs ? most : std::log1p(most);
  };
  return {largest(all), largest(steady), std::log1p(gap_of(steady))};
}

double OmnibusTest::smallest(const Views& seen) const {
  double p = 1;
  for (std::size_t k = 0; k < views; ++k) p = std::min(p, nulls_[k].p_value(seen[k]));
  return p;
}

double OmnibusTest::p_value(const Eigen::VectorXd& z) const {
  return combined_->p_value(-std::log(smallest(look(z, weights_))));
}

}  // namespace atomcam
