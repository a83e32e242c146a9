#include "calibration/input_check.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"

namespace atomcam {

void check_input(const CalibrationInput& input, std::size_t frames, const Notes& notes) {
  const Shape shape = input.frames->shape();
  if (frames < 8)
    throw Error("frames",
                fmt::format("{} frames are too few to calibrate from, 8 or more are needed", frames));
  if (notes.shape.rows > 0 && !(shape == notes.shape))
    throw Error(notes.place + ": shape",
                fmt::format("is {} x {}, but the frames have {} rows and {} columns", notes.shape.rows,
                            notes.shape.columns, shape.rows, shape.columns));
  if (input.darks && input.darks->frames() < 4)
    throw Error("darks", fmt::format("{} frames are too few, 4 or more are needed", input.darks->frames()));
  if (input.darks && !(input.darks->shape() == shape))
    throw Error("darks",
                fmt::format("have {} rows and {} columns, the frames {} and {}", input.darks->shape().rows,
                            input.darks->shape().columns, shape.rows, shape.columns));
  if (input.background) {
    if (!(input.background->shape() == shape))
      throw Error("background", fmt::format("has {} rows and {} columns, the frames {} and {}",
                                            input.background->shape().rows, input.background->shape().columns,
                                            shape.rows, shape.columns));
    if (input.background->frames() < 2) throw Error("background", "has one frame, 2 or more are needed");
  }
  if (!input.flats.empty() && !input.darks)
    throw Error("flats", "need darks of the same settings beside them");
  if (notes.grid)
    for (const int j : {0, notes.grid->rows - 1})
      for (const int i : {0, notes.grid->columns - 1}) {
        const double x = notes.grid->first_x_px + i * notes.grid->spacing_px,
                     y = notes.grid->first_y_px + j * notes.grid->spacing_px;
        const double slack = 0.15 * std::max(shape.columns, shape.rows) + 3;
        if (x < -slack || y < -slack || x > shape.columns + slack || y > shape.rows + slack)
          throw Error(
              notes.place + ": site_grid",
              fmt::format("puts a site at x {:.1f}, y {:.1f}, outside of the frames of {} x {} pixels", x, y,
                          shape.columns, shape.rows));
      }
}

}  // namespace atomcam
