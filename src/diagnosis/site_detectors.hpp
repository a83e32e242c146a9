#pragma once
// Two detectors of atoms, as a lab would use them on frames without truth.

#include <cstddef>
#include <span>
#include <vector>

#include "analysis/stack_model.hpp"

namespace atomcam {

/// Scores of every site in a frame. Built from the stack model that calibration gives, the same for real and
/// simulated frames.
class SiteDetector {
 public:
  enum class Kind {
    threshold,  // sum of the counts above the dark level in a square that holds three quarters of the light
    matched,    // sum weighted by the site's share of light over the variance of a pixel half of the time lit
  };
  SiteDetector(const StackModel& model, Kind kind);

  std::size_t sites() const { return windows_.size(); }
  /// Electrons of the atom, one per site (a threshold's square: of the light within it).
  void score(const CountImage& frame, std::span<float> scores) const;

 private:
  struct Window {
    std::vector<std::size_t> pixels;
    std::vector<float> weights;
  };
  std::vector<Window> windows_;
  double level_ = 0;
};

/// What fits a set of scores best: a normal peak of empty sites, one of filled sites, and between the two an
/// even bridge of atoms that were lost while the shutter was open.
struct TwoPeaks {
  double filled = 0;  // part of the upper peak
  double lost = 0;    // part of the bridge
  double lower = 0, upper = 0, lower_width = 1, upper_width = 1;
  double threshold = 0;  // where a site is as likely empty as not
  /// Distance of the peaks in root mean squares of their widths.
  double separation() const;
  /// Part of the sites that the threshold calls rightly: empty, or with an atom when the shutter opened.
  double fidelity() const;
};
/// Maximum likelihood over a histogram of the scores. NaN for fewer than 50, and where there are no two peaks
/// (less than two widths apart, or one with fewer than twenty scores).
TwoPeaks two_peaks(std::span<const float> scores);

}  // namespace atomcam
