#pragma once
// Where the sites are, as six numbers.

#include "calibration/mean_image.hpp"
#include "calibration/notes.hpp"
#include "scene/scene.hpp"

namespace atomcam {

/// A lattice of sites: position(i, j) = origin + i a + j b, in pixels of the frame.
struct Lattice {
  int columns = 0, rows = 0;
  double origin_x = 0, origin_y = 0;
  double a_x = 0, a_y = 0;  // from one column to the next
  double b_x = 0, b_y = 0;  // from one row to the next
  double x(int i, int j) const { return origin_x + i * a_x + j * b_x; }
  double y(int i, int j) const { return origin_y + i * a_y + j * b_y; }
  int sites() const { return columns * rows; }
};

/// As noted; as a lab has it.
Lattice lattice_of(const NotedGrid& grid);
SiteGrid grid_of(const Lattice& lattice);

/// Noted positions moved to where the light is: displacement, spacing and angles, by the correlation of the
/// mean image with a lattice of spots of `spot_px` rms.
Lattice find_lattice(const MeanImage& mean, const Lattice& noted, double spot_px);

}  // namespace atomcam
