#include "calibration/maximise.hpp"

#include <Eigen/Sparse>
#include <cmath>

namespace atomcam {
namespace {

/// Of a symmetric positive matrix. A large one may be mostly zeros: sites far from each other know nothing of
/// each other.
class Solver {
 public:
  explicit Solver(const Eigen::MatrixXd& matrix) {
    constexpr Eigen::Index large = 200;
    constexpr double mostly_zero = 0.2;  // share of the entries that are not
    if (matrix.rows() > large) {
      const Eigen::SparseMatrix<double> entries = matrix.sparseView();
      sparse_ = static_cast<double>(entries.nonZeros()) < mostly_zero * static_cast<double>(matrix.size());
      if (sparse_) of_entries_.compute(entries);
    }
    if (!sparse_) of_all_.compute(matrix);
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& right) const {
    if (sparse_) return of_entries_.solve(right);
    return of_all_.solve(right);
  }

 private:
  bool sparse_ = false;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> of_entries_;
  Eigen::LDLT<Eigen::MatrixXd> of_all_;
};

}  // namespace

Eigen::MatrixXd MaximumLikelihood::covariance() const {
  return information.completeOrthogonalDecomposition().pseudoInverse();
}

Eigen::MatrixXd MaximumLikelihood::covariance(const std::vector<Eigen::Index>& of) const {
  const auto count = static_cast<Eigen::Index>(of.size());
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(information.rows(), count);
  for (Eigen::Index k = 0; k < count; ++k) columns(of[static_cast<std::size_t>(k)], k) = 1;
  const Eigen::MatrixXd solved = Solver(information).solve(columns);
  return solved(of, Eigen::all);
}

MaximumLikelihood maximise(const Eigen::VectorXd& start,
                           const std::function<Likelihood(const Eigen::VectorXd&, bool)>& evaluate,
                           double tolerance, int most_steps) {
  MaximumLikelihood best;
  best.values = start;
  Likelihood at = evaluate(start, true);
  double damping = 1e-3;
  for (; best.steps < most_steps && !best.converged; ++best.steps) {
    bool better = false;
    for (int attempt = 0; attempt < 12 && !better; ++attempt) {
      Eigen::MatrixXd damped = at.information;
      for (Eigen::Index i = 0; i < damped.rows(); ++i) damped(i, i) += damping * at.information(i, i) + 1e-12;
      const Eigen::VectorXd step = -Solver(damped).solve(at.gradient);
      if (!step.allFinite()) {
        damping *= 10;
        continue;
      }
      const double promised = -(at.gradient.dot(step) + 0.5 * step.dot(at.information * step));
      if (promised < tolerance) {
        best.converged = true;
        break;
      }
      const Eigen::VectorXd there = best.values + step;
      const Likelihood tried = evaluate(there, false);
      if (std::isfinite(tried.minus_log) && tried.minus_log < at.minus_log) {
        best.values = there;
        at = evaluate(there, true);
        damping = std::max(damping * 0.1, 1e-9);
        better = true;
      } else {
        damping *= 10;
      }
    }
    if (!better) break;
  }
  best.minus_log = at.minus_log;
  best.information = std::move(at.information);
  return best;
}

}  // namespace atomcam
