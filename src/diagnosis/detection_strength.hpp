#pragma once
// How strong an effect has to be to be seen: the unit in which diagnoses of different effects compare.

#include <array>
#include <vector>

#include "calibration/notes.hpp"
#include "diagnosis/model.hpp"

namespace atomcam {

struct DetectionStrength {
  /// Of the effect's first parameter: in nine of ten such stacks a gap is seen (at gap_level).
  double strength = 0;
  /// The same for a test that knows the effect's fingerprint on the battery's statistics and looks for
  /// nothing else: no test of these statistics needs less. 0 if the effect moves them too little to say.
  double matched_filter = 0;
  /// False: not even at the largest strength that the catalogue allows, which `strength` then is.
  bool reached = true;
};

/// Stacks of one lab without effects and how they are judged: what detection is measured against.
class DetectionGround {
 public:
  /// `lab`: the truth; its stacks are calibrated with the notes.
  DetectionGround(const Lab& lab, const Notes& notes, std::size_t frames, std::size_t dark_frames,
                  int threads);
  /// The effect at these parameters but for the first, which is varied. Good to some percent.
  DetectionStrength of(const EffectDeclaration& effect, ParameterValues values) const;

 private:
  struct Seen {
    double log_p = 0;  // ninth decile of the p-values, logarithm
    /// From stacks without it, squared, in standard deviations along the effect's own way.
    double distance = 0;
  };
  /// Compressed residuals, means over either half of some stacks: their scatter is not taken for signal.
  using Halves = std::array<Eigen::VectorXd, 2>;
  static Halves halves_of(const Eigen::MatrixXd& residuals);
  /// A row per stack. `followed`: what the plain model's statistics do as calibrating absorbs a part of the
  /// effect.
  Eigen::MatrixXd residuals(const Population& population, const Eigen::VectorXd& followed) const;
  double squared_distance(const Halves& from_none) const;
  Seen look(const EffectDeclaration& effect, ParameterValues values, double strength) const;
  /// By how much some stacks' calibrations say more than the one that the plain model is about, on average.
  Eigen::VectorXd mean_offset(const Lab& lab) const;
  /// Mean statistics of plain stacks whose parameters are so far from the plain model's.
  Eigen::VectorXd plain_middle(const Eigen::VectorXd& offset) const;

  Lab lab_;
  Notes notes_;
  StackPlan plan_;
  Calibration calibration_;
  Model plain_;
  Eigen::VectorXd own_offset_, own_middle_;  // of stacks without an effect
  Halves none_;
  Eigen::MatrixXd own_;  // compressed residuals of the plain model's stacks, a row each
  std::vector<Correlation> without_fold_;
};

}  // namespace atomcam
