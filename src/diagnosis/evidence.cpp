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

Correlation::Correlation(const Eigen::MatrixXd& own) {
  const Eigen::MatrixXd y = compressed_rows(own);
  const double n = static_cast<double>(y.rows()), p = static_cast<double>(y.cols());
  matrix = (y.transpose() * y) / std::max(1.0, n);
  const double keep = n / (n + p);
  matrix *= keep;
  matrix.diagonal().array() += 1 - keep;
}

OmnibusTest::OmnibusTest(const Standard& standard, const Eigen::MatrixXd& directions) {
  const Eigen::MatrixXd& own = standard.own();
  if (directions.rows() > 0) {
    const Correlation correlation(own);
    const auto solver = correlation.matrix.ldlt();
    filters_.resize(directions.rows(), directions.cols());
    for (Eigen::Index k = 0; k < directions.rows(); ++k) {
      Eigen::VectorXd filter = solver.solve(directions.row(k).transpose());
      const double size = std::sqrt(std::max(1e-12, filter.dot(correlation.matrix * filter)));
      filters_.row(k) = filter.transpose() / size;
    }
  }
  std::vector<double> samples[3];
  std::vector<Eigen::Vector3d> seen;
  for (Eigen::Index n = 0; n < own.rows(); ++n) {
    seen.push_back(views(own.row(n).transpose()));
    for (int k = 0; k < 3; ++k) samples[k].push_back(seen.back()(k));
  }
  for (auto& one : samples) nulls_.emplace_back(std::move(one));
  std::vector<double> smallest_p;
  for (const auto& one : seen) smallest_p.push_back(-std::log(smallest(one)));
  combined_.emplace_back(smallest_p);
  for (const double value : smallest_p) own_p_.push_back(combined_.front().p_value(value));
}

Eigen::Vector3d OmnibusTest::views(const Eigen::VectorXd& z) const {
  Eigen::Vector3d out;
  out(0) = z.size() ? std::log1p(z.cwiseAbs().maxCoeff()) : 0;
  out(1) = std::log1p(gap_of(z));
  out(2) = filters_.rows() ? (filters_ * compressed(z)).maxCoeff() : 0;
  return out;
}

double OmnibusTest::smallest(const Eigen::Vector3d& views) const {
  double p = 1;
  for (int k = 0; k < (filters_.rows() ? 3 : 2); ++k)
    p = std::min(p, nulls_[static_cast<std::size_t>(k)].p_value(views(k)));
  return p;
}

double OmnibusTest::p_value(const Eigen::VectorXd& z) const {
  return combined_.front().p_value(-std::log(smallest(views(z))));
}

}  // namespace atomcam
