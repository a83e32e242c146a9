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

/// Stacks of one lab, how they are calibrated and judged: what detection is measured on.
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
  /// Stacks of a lab, judged by the plain model about one of them: calibrating it has absorbed what it can of
  /// an effect, and the plain model scatters as it does there.
  struct Judged {
    Model plain;
    Eigen::MatrixXd residuals;       // a row per stack
    Eigen::VectorXd middle() const;  // compressed
  };
  Judged judge(const Lab& lab, std::string_view stream, int count, StackPlan plan) const;
  /// Twins with no chance in common, neither of the stacks nor of what is calibrated.
  std::array<Judged, 2> judge_twice(const Lab& lab, std::string_view stream, int count) const;
  double squared_distance(const std::array<Judged, 2>& twins) const;
  Seen look(const EffectDeclaration& effect, ParameterValues values, double strength) const;

  Lab lab_;
  Notes notes_;
  StackPlan plan_;
  std::array<Judged, 2> none_;
};

}  // namespace atomcam
