#include "simulation/point_spread_image.hpp"

#include <cmath>

#include <fmt/format.h>

#include "base/error.hpp"

namespace atomcam {

PhotonImage point_spread_image(const Lab& lab, const PointSpreadView& view) {
  constexpr int most = 4096;
  if (view.shape.rows < 1 || view.shape.columns < 1 || view.shape.rows > most || view.shape.columns > most)
    throw Error("shape", fmt::format("{} x {} pixels; allowed 1 to {} each", view.shape.columns,
                                     view.shape.rows, most));
  if (view.oversampling < 1 || view.oversampling > 64)
    throw Error("oversampling", fmt::format("{}; allowed 1 to 64", view.oversampling));
  if (!(std::abs(view.x_px) <= 1e5) || !(std::abs(view.y_px) <= 1e5))
    throw Error("x_px, y_px", fmt::format("{}, {}; allowed -1e5 to 1e5", view.x_px, view.y_px));
  Lab placed = lab;
  placed.place_sites();
  placed.optics.pixel_um /= view.oversampling;
  const PointSpreadFunction function(placed.optics, 0, placed.scene.atom_extent_um);
  PhotonImage image(view.shape);
  function.add_expected(image, 1, (view.shape.columns - 1) * 0.5 + view.x_px * view.oversampling,
                        (view.shape.rows - 1) * 0.5 + view.y_px * view.oversampling);
  return image;
}

}  // namespace atomcam
