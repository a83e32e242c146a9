#pragma once
// How dark pixels' counts differ from the law of the calibrated camera, band by band of counts.

#include <algorithm>
#include <span>
#include <vector>

#include "analysis/layout.hpp"
#include "analysis/sheet.hpp"

namespace atomcam::analysis {

/// What another calibration would change is taken out of the differences, so that only the shape counts: a
/// charge born in the register shows between the read noise and the exponential tail.
class LawBands {
 public:
  explicit LawBands(const Layout& layout);

  /// Of a count near the middle of the law; 1 for all where no law is known.
  double probability(std::size_t code) const {
    const std::vector<double>& all = expected_.probability;
    if (all.empty()) return 1;
    const std::ptrdiff_t k = static_cast<std::ptrdiff_t>(code) - expected_.first;
    return std::max(1e-12,
                    all[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k, 0, std::ssize(all) - 1))]);
  }

  /// Each band's pixels less the expected ones, in Poisson deviations; and the misfit of all counts. `below`:
  /// number of pixels with a count below first + k, up to all of them.
  void put(std::span<const double> below, int first, Sheet& sheet) const;

 private:
  struct Bin {
    int end = 0;  // counts below it, and from the end of the bin before it on
    double probability = 0;
    std::size_t band = 0;
  };
  const ExpectedCounts& expected_;
  std::vector<Bin> bins_;
  std::vector<std::vector<double>> basis_;  // orthonormal, per square root of an expected number
};

}  // namespace atomcam::analysis
