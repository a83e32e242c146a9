#pragma once
// Stacks whose effects are known to nobody but a seal: what a diagnosis is judged on.

#include <cstdint>
#include <string>
#include <vector>

#include "simulation/lab.hpp"

namespace atomcam {

struct BlindEffect {
  std::string name, stage;
  double strength = 0;  // of its first parameter; 0: not told in its unit
  /// In stacks of this lab and size; 0 where strengths were not drawn in units of it.
  double detection_strength = 0, matched_filter = 0;
};

struct BlindStack {
  Lab lab;            // the truth
  std::string notes;  // JSON, tens of percent off
  std::vector<BlindEffect> effects;
};

struct BlindOptions {
  std::uint64_t seed = 1;
  int rows = 96, columns = 96;
  /// Exposure, gains, bias, optics, stray light, filling and grid of all kinds; else of one usual lab per
  /// camera. What the notes do not tell is drawn either way.
  bool any_lab = false;
  /// Effects to choose from; empty: the catalogue.
  std::vector<std::string> effects;
  double none_share = 0.2, pair_share = 0.2;
  /// Strengths are drawn evenly (in the logarithm) between these multiples of the effect's default, or of the
  /// strength at which nine of ten stacks of this lab with so many frames and darks show a gap (of effects
  /// that the catalogue allows to be so strong).
  double weakest = 0.5, strongest = 3;
  bool of_detection = false;
  std::size_t frames = 300, darks = 100;
  int threads = 1;
};

/// Stack `number` of a series: a pure function of options and number.
BlindStack make_blind_stack(const BlindOptions& options, std::uint64_t number);

}  // namespace atomcam
