#pragma once
// The point-spread function of a lab as people want to look at it.

#include "simulation/lab.hpp"

namespace atomcam {

struct PointSpreadView {
  Shape shape{33, 33};
  double x_px = 0;  // of the atom's geometric image, in physical pixels from the middle of the picture
  double y_px = 0;
  int oversampling = 1;  // pixels of the picture per physical pixel, along each axis
};

/// The share of an atom's light on each pixel, [row, column]; the atom's extent is in it. The middle is at
/// ((columns - 1) / 2, (rows - 1) / 2).
PhotonImage point_spread_image(const Lab& lab, const PointSpreadView& view);

}  // namespace atomcam
