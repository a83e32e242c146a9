#pragma once
// Slanted stripes in frames without atoms: a disturbance picked up along the readout.

#include <optional>

#include "analysis/frame_sequence.hpp"

namespace atomcam {

struct Stripes {
  double period_px = 0;      // along a row
  double row_phase_deg = 0;  // by how much they go on from row to row, in (-180, 180]
};

/// The strongest ones, whatever their phase in each frame: where the mean power spectrum of what the frames
/// have beside their mean stands out clearly; none: empty.
std::optional<Stripes> strongest_stripes(const FrameSequence& frames);

}  // namespace atomcam
