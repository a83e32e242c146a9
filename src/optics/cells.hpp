#pragma once
// The table of a point-spread function: five nested square grids of `side` by `side` cells, each three times
// as coarse as the one before; the inner third of a grid is left to the finer ones. Cell (row j, column i) of
// level l covers [(i - side / 2) w, (i + 1 - side / 2) w) in x, and in y alike, with w = finest * 3^l.

#include <cstdint>
#include <span>
#include <vector>

#include "optics/optics.hpp"

namespace atomcam {

inline constexpr int cell_levels = 5;
inline constexpr double finest_cell = 1.0 / 40;  // diffraction units (wavelength / NA)

struct Cells {
  int side = 0;               // a multiple of 6
  std::vector<double> share;  // [level, row, column], sum 1; 0 in the inner third of levels > 0
  std::size_t index(int level, int row, int column) const {
    return (static_cast<std::size_t>(level) * static_cast<std::size_t>(side) +
            static_cast<std::size_t>(row)) *
               static_cast<std::size_t>(side) +
           static_cast<std::size_t>(column);
  }
};

/// The light in every cell, tilts left out. Throws an Error if the wavefront or the blur is too wide for a
/// table.
Cells point_spread_cells(const OpticsDescription& optics, Blur blur);

/// Integers of sum `total` (at most 2^32) nearest to share * total; what rounding leaves over goes to the
/// largest.
std::vector<std::uint32_t> integer_weights(std::span<const double> share, std::uint64_t total);

}  // namespace atomcam
