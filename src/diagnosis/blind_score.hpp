#pragma once
// What diagnoses made of stacks whose seals are opened, as tables.

#include <map>
#include <string>
#include <vector>

#include "diagnosis/blind.hpp"

namespace atomcam {

/// A diagnosis beside the truth.
struct BlindResult {
  struct Found {
    std::string name, stage;
    double low = 0, high = 0;  // of the strength, the effect's first parameter: 68 % interval
  };
  std::vector<BlindEffect> sealed;
  std::string verdict;  // as in diagnosis.json
  std::vector<Found> found;
  std::string unexplained_stage;
  double p_gap = 1;
  double closed = 0;
};

class BlindScore {
 public:
  void add(const BlindResult& result);
  /// A stack that could not be diagnosed: calibration refused it.
  void add_refused() { ++refused_; }
  /// Markdown: outcomes by sealed effect, rates, and what each sealed effect was called.
  std::string tables() const;

 private:
  struct Outcome {
    int stacks = 0, no_gap = 0, named = 0, wrong = 0, partly = 0, ambiguous = 0, unexplained = 0,
        stage_right = 0, with_stage = 0;
    std::vector<double> closed;
  };
  static void count(Outcome& outcome, const BlindResult& result);

  std::map<std::string, Outcome> outcomes_;
  std::map<std::string, std::map<std::string, int>> called_;  // sealed: what it was called: how often
  std::vector<double> null_p_;
  std::vector<double> over_matched_filter_;  // detection strengths
  int strengths_ = 0, covered_ = 0;
  int refused_ = 0;
  int pairs_ = 0, pairs_both_ = 0;
};

/// Probability of a Kolmogorov-Smirnov distance from the uniform law as large as that of these values, for
/// some tens of them or more (Kolmogorov's law with Stephens' correction).
double uniform_p_value(std::vector<double> values);

}  // namespace atomcam
