#pragma once
// Two models of one stack: which of them it is likelier to be of.

#include "diagnosis/model.hpp"

namespace atomcam {

/// What a number is for a model's stacks: Student's law, as real frames are of no model to all digits.
class StacksLaw {
 public:
  /// `least`: finer than this nothing is known.
  StacksLaw(const Eigen::VectorXd& of_stacks, double least);
  double log_density(double value) const;

 private:
  double middle_ = 0, spread_ = 1;
};

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
  const Model& one_;
  const Model& other_;
  StacksLaw of_one_, of_other_;  // of the ratio, for stacks of the one model and of the other
};

/// Logarithm of how much likelier a stack is of the one model by nothing but how far it is on the way from
/// the other's mean to the one's (R. A. Fisher's linear discriminant, 1936, without what is chance of the
/// means). A full likelihood of a thousand statistics drowns a small difference in a few of them; this one
/// knows of no scatter. 0 if the means hardly differ.
double discriminant_odds(const Model& one, const Model& other, const Eigen::VectorXd& statistics);

}  // namespace atomcam
