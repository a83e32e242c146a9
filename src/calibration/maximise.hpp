#pragma once
// Maximum likelihood by Levenberg's damped Newton steps with the expected information in place of second
// derivatives; linear algebra by Eigen.

#include <Eigen/Dense>
#include <functional>

namespace atomcam {

/// Minus the logarithm of a likelihood, its gradient and its expected second derivatives.
struct Likelihood {
  double minus_log = 0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd information;
};

struct MaximumLikelihood {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;  // inverse of the information
  double minus_log = 0;
  int steps = 0;
  bool converged = false;
};

/// From `start` on; `evaluate(values, with_derivatives)`. Stops when a step would gain less than
/// `tolerance` in the logarithm, or after `most_steps`.
MaximumLikelihood maximise(const Eigen::VectorXd& start,
                           const std::function<Likelihood(const Eigen::VectorXd&, bool)>& evaluate,
                           double tolerance = 1e-4, int most_steps = 60);

}  // namespace atomcam
