#include "calibration/maximise.hpp"

#include <cmath>

namespace atomcam {

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
      const Eigen::VectorXd step = -damped.ldlt().solve(at.gradient);
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
  best.covariance = at.information.completeOrthogonalDecomposition().pseudoInverse();
  return best;
}

}  // namespace atomcam
