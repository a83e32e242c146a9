#pragma once
// What an effect does to the battery as a function of its parameters, learned from some tens of simulated
// stacks: a Gaussian process per statistic with common length scales.

#include <Eigen/Dense>
#include <vector>

#include "diagnosis/uncertain.hpp"

namespace atomcam {

class Emulator {
 public:
  /// `draws`: coordinates of the effect's parameters by stack; `values`: compressed z by stack. At the lower
  /// end of the first parameter (the strength) the effect is taken to be nothing.
  Emulator(std::vector<Uncertain> open, const Eigen::MatrixXd& draws, const Eigen::MatrixXd& values);

  struct Prediction {
    Eigen::VectorXd mean, variance;  // variance: of the prediction, without a stack's own noise
  };
  Prediction operator()(const Eigen::VectorXd& coordinates) const;
  const std::vector<Uncertain>& open() const { return open_; }

 private:
  Eigen::VectorXd features(const Eigen::VectorXd& coordinates) const;
  double kernel(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const;

  std::vector<Uncertain> open_;
  double strength_length_ = 0.3, shape_length_ = 1;
  double chosen_strength_ = 0.3, chosen_shape_ = 1;
  std::vector<Eigen::VectorXd> points_;
  Eigen::VectorXd amplitude_;             // variance of each statistic over the draws
  std::vector<int> group_;                // of each statistic, by its noise
  std::vector<Eigen::MatrixXd> inverse_;  // per group
  Eigen::MatrixXd weights_;               // [point, statistic]
};

}  // namespace atomcam
