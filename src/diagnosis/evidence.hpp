#pragma once
// How far a stack is from a model, in one number, and with which probability the model gives as much.

#include <Eigen/Dense>

#include "diagnosis/standard.hpp"

namespace atomcam {

/// Grows like z, then like its logarithm: one huge statistic must not outvote all others.
Eigen::VectorXd compressed(const Eigen::VectorXd& z);
Eigen::MatrixXd compressed_rows(const Eigen::MatrixXd& z);

/// Mean of the squares of the 12 largest |z|: the gap.
double gap_of(const Eigen::VectorXd& z);

/// Correlations of a model's statistics, shrunk towards independence; and its inverse.
struct Correlation {
  explicit Correlation(const Eigen::MatrixXd& own);
  Eigen::MatrixXd matrix;
};

/// Does a stack differ from the model? Three views, each with its null from the model's own stacks: the
/// largest |z|, the gap, and the best of given directions (fingerprints of known effects); one p-value.
class OmnibusTest {
 public:
  /// `directions`: rows, in compressed z; may be empty.
  OmnibusTest(const Standard& standard, const Eigen::MatrixXd& directions = {});
  double p_value(const Eigen::VectorXd& z) const;
  /// p-values of the model's own stacks (each was judged without itself).
  const std::vector<double>& own_p_values() const { return own_p_; }

 private:
  Eigen::Vector3d views(const Eigen::VectorXd& z) const;
  double smallest(const Eigen::Vector3d& views) const;

  Eigen::MatrixXd filters_;
  std::vector<NullDistribution> nulls_;
  std::vector<NullDistribution> combined_;
  std::vector<double> own_p_;
};

}  // namespace atomcam
