#pragma once

#include <fmt/format.h>

#include "base/error.hpp"
#include "sensor/sensor.hpp"

namespace atomcam {

/// The atoms' electrons of one frame, checked against the plane they land on. No rows at all: no atoms.
class PhotoElectronRows {
 public:
  PhotoElectronRows(const PhotoElectrons& atoms, Shape plane) : atoms_(&atoms) {
    if (!atoms.row_begin.empty() && atoms.row_begin.size() != static_cast<std::size_t>(plane.rows) + 1)
      throw Error("atoms.row_begin", fmt::format("{} entries; the readout's {} rows need {}",
                                                 atoms.row_begin.size(), plane.rows, plane.rows + 1));
  }
  void add(int row, std::span<std::int32_t> electrons) const {
    if (atoms_->row_begin.empty()) return;
    for (const std::uint16_t column : atoms_->row(row)) {
      if (column >= electrons.size())
        throw Error("atoms.columns", fmt::format("{}; the readout has {} columns", column, electrons.size()));
      ++electrons[column];
    }
  }

 private:
  const PhotoElectrons* atoms_;  // the caller's; lives as long as the readout
};

}  // namespace atomcam
