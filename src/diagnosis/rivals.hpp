#pragma once
// Two models of one stack: which of them it is likelier to be of.

#include "diagnosis/model.hpp"

namespace atomcam {

/// Likelihoods that are learned from some ninety stacks of a thousand statistics say by themselves little
/// about which model is right: what is wide, or known from fewer stacks, loses by tens where there is nothing
/// to lose. But stacks of both models are there: what their ratio is for those of the one, and for those of
/// the other, says what it means (D. R. Cox, 1961: tests of separate families of hypotheses).
class Rivals {
 public:
  /// Judged models, which must outlive this.
  Rivals(const Model& one, const Model& other);

  /// Logarithm of the likelihoods' ratio for a stack, one over other.
  double ratio(const Eigen::VectorXd& statistics) const;
  /// Logarithm of how much likelier such a ratio is for a stack of the one model than of the other.
  double odds(const Eigen::VectorXd& statistics) const;

 private:
  struct Law {
    double middle = 0, spread = 1;
    explicit Law(const Eigen::VectorXd& ratios);
    double log_density(double ratio) const;
  };

  const Model& one_;
  const Model& other_;
  Law of_one_, of_other_;  // of the ratio, for stacks of the one model and of the other
};

}  // namespace atomcam
