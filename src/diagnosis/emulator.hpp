#pragma once
// What an effect does to the battery as a function of its parameters, learned from some tens of simulated
// stacks: a Gaussian process per statistic with common length scales, and about it the scatter that those
// stacks show.

#include <Eigen/Dense>
#include <vector>

#include "diagnosis/uncertain.hpp"

namespace atomcam {

class Emulator {
 public:
  /// `draws`: coordinates of the effect's parameters by stack; `values`: compressed z by stack. At the lower
  /// end of the first parameter (the strength) the effect is taken to be nothing.
  Emulator(std::vector<Uncertain> open, const Eigen::MatrixXd& draws, const Eigen::MatrixXd& values);

  /// What it foretells at some places, coordinates of the parameters [parameter, place]: [statistic, place].
  Eigen::MatrixXd mean(const Eigen::MatrixXd& places) const;
  /// By which stacks near these places scatter about what the others foretell of them, beyond the scatter
  /// that stacks without the effect have (1): the emulator may be wrong there, or the effect comes out
  /// differently every time. [statistic, place]
  Eigen::MatrixXd variance(const Eigen::MatrixXd& places) const;

 private:
  Eigen::VectorXd features(const Eigen::VectorXd& coordinates) const;
  double kernel(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const;

  std::vector<Uncertain> open_;
  double strength_length_ = 0.3, shape_length_ = 1;
  std::vector<Eigen::VectorXd> points_;
  Eigen::MatrixXd weights_;  // [point, statistic]
  Eigen::MatrixXd missed_;   // [stack, statistic] squares of leave-one-out errors
};

}  // namespace atomcam
