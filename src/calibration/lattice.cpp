#include "calibration/lattice.hpp"

#include <cmath>

#include "base/math.hpp"

namespace atomcam {
namespace {

constexpr double degree = math::pi / 180;

}  // namespace

Lattice lattice_of(const NotedGrid& grid) {
  Lattice lattice;
  lattice.columns = grid.columns;
  lattice.rows = grid.rows;
  lattice.origin_x = grid.first_x_px;
  lattice.origin_y = grid.first_y_px;
  const double angle = grid.angle_deg * degree;
  lattice.a_x = grid.spacing_px * std::cos(angle);
  lattice.a_y = grid.spacing_px * std::sin(angle);
  lattice.b_x = -lattice.a_y;
  lattice.b_y = lattice.a_x;
  return lattice;
}

SiteGrid grid_of(const Lattice& lattice) {
  SiteGrid grid;
  grid.columns = lattice.columns;
  grid.rows = lattice.rows;
  grid.offset_x = lattice.origin_x;
  grid.offset_y = lattice.origin_y;
  grid.spacing_x = std::hypot(lattice.a_x, lattice.a_y);
  grid.spacing_y = std::hypot(lattice.b_x, lattice.b_y);
  grid.angle_x_deg = std::atan2(lattice.a_y, lattice.a_x) / degree;
  grid.angle_y_deg = std::atan2(-lattice.b_x, lattice.b_y) / degree;
  return grid;
}

}  // namespace atomcam
