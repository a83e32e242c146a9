#pragma once
// Maximum likelihood by Levenberg's damped Newton steps with the expected information in place of second
// derivatives; linear algebra by Eigen.

#include <Eigen/Dense>
#include <functional>
#include <vector>

namespace atomcam {

/// Minus the logarithm of a likelihood, its gradient and its expected second derivatives.
struct Likelihood {
  double minus_log = 0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd information;
};

struct MaximumLikelihood {
  Eigen::VectorXd values;
  Eigen::MatrixXd information;  // there
  double minus_log = 0;
  int steps = 0;
  bool converged = false;

  /// Inverse of the information: of all parameters, or the rows and columns of these.
  Eigen::MatrixXd covariance() const;
  Eigen::MatrixXd covariance(const std::vector<Eigen::Index>& of) const;
};

/// From `start` on; `evaluate(values, with_derivatives)`. Stops when a step would gain less than
/// `tolerance` in the logarithm, or after `most_steps`.
MaximumLikelihood maximise(const Eigen::VectorXd& start,
                           const std::function<Likelihood(const Eigen::VectorXd&, bool)>& evaluate,
                           double tolerance = 1e-4, int most_steps = 60);

}  // namespace atomcam
