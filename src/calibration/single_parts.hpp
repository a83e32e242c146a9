#pragma once
// What a full calibration knows beyond the plain model: of single sites and single pixels.

#include <cstdint>
#include <span>
#include <vector>

#include "calibration/calibrate.hpp"

namespace atomcam {

/// Gives each site of the calibration's lab the brightness that it has in the frames in which its atom is
/// there. `brightness_e`: [frame, site]; `atom_e`: light of an atom.
void add_site_brightness(Calibration& calibration, std::span<const float> brightness_e, double atom_e);

/// Of dark frames; `odd`: the pixels that are listed as hot.
PixelMaps pixel_maps(const StackSums& darks, std::span<const std::uint8_t> odd);

}  // namespace atomcam
