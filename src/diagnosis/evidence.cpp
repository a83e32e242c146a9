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

OmnibusTest::OmnibusTest(const Eigen::MatrixXd& own, std::vector<bool> unsteady)
    : unsteady_(std::move(unsteady)) {
  std::array<std::vector<double>, views> samples;
  for (Eigen::Index n = 0; n < own.rows(); ++n) {
    const Views seen = look(own.row(n).transpose());
    for (std::size_t k = 0; k < views; ++k) samples[k].push_back(seen[k]);
  }
  // Every stack is held against the others, as the real one is.
  std::vector<double> smallest_p(samples.front().size(), 1);
  for (const auto& view : samples)
    for (std::size_t n = 0; n < view.size(); ++n) {
      std::vector<double> others = view;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(n));
      smallest_p[n] = std::min(smallest_p[n], NullDistribution(std::move(others)).p_value(view[n]));
    }
  for (double& p : smallest_p) p = -std::log(p);
  for (auto& one : samples) nulls_.emplace_back(std::move(one));
  combined_.emplace(std::move(smallest_p));
}

OmnibusTest::Views OmnibusTest::look(const Eigen::VectorXd& z) const {
  Eigen::VectorXd steady = z;
  for (Eigen::Index i = 0; i < z.size(); ++i)
    if (const auto at = static_cast<std::size_t>(i); at < unsteady_.size() && unsteady_[at]) steady(i) = 0;
  const auto largest = [](const Eigen::VectorXd& of) { return of.size() ? of.cwiseAbs().maxCoeff() : 0; };
  return {std::log1p(largest(z)), std::log1p(largest(steady)), std::log1p(gap_of(steady))};
}

double OmnibusTest::smallest(const Views& seen) const {
  double p = 1;
  for (std::size_t k = 0; k < views; ++k) p = std::min(p, nulls_[k].p_value(seen[k]));
  return p;
}

double OmnibusTest::p_value(const Eigen::VectorXd& z) const {
  return combined_->p_value(-std::log(smallest(look(z))));
}

}  // namespace atomcam
