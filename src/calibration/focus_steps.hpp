#pragma once

#include <array>
#include <vector>

#include "calibration/pupil_image.hpp"

namespace atomcam {

/// Images of a point at steps of defocus, between which it changes evenly enough; or one for the whole field.
/// What they hold are coefficients of splines, for CubicWeights.
class FocusSteps {
 public:
  /// `zernike_um` in the field's middle, `lowest_um` to `highest_um` of defocus added to it. `changes` makes
  /// the derivatives, if there are to be any.
  FocusSteps(const PupilImage& image, const PupilImage& changes, std::array<double, zernike_terms> zernike_um,
             double lowest_um, double highest_um, bool derivatives);
  /// At a defocus between the lowest and the highest; `between` holds it if it has to be made.
  const FineImage& at(double defocus_um, FineImage& between) const;

 private:
  double lowest_, step_ = 0;
  std::vector<FineImage> images_;
};

}  // namespace atomcam
