#pragma once
// How dark pixels' counts differ from the law of the calibrated camera, band by band of counts.

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

  /// Each band's pixels less the expected ones, in Poisson deviations; and the misfit of all counts. `below`:
  /// number of pixels with a count below first + k, up to all of them.
  void put(std::span<const double> below, int first, Sheet& sheet) const;

 private:
  struct Bin {
    int begin = 0, end = 0;  // counts from begin on, below end
    double probability = 0;
    std::size_t band = 0;
  };
  std::vector<Bin> bins_;
  std::vector<std::vector<double>> basis_;  // orthonormal, per square root of an expected number
};

}  // namespace atomcam::analysis
