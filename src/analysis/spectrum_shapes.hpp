#pragma once
// What stands out of a power spectrum of an image.

#include <span>

#include "analysis/sheet.hpp"

namespace atomcam::analysis {

/// Puts the largest peak along rows, along columns and oblique, the share of low frequencies and of the line
/// along the readout; `power` is [row frequency, column frequency] of rows x (columns / 2 + 1).
void put_spectrum(Sheet& sheet, std::span<const float> power, int rows, int columns);

}  // namespace atomcam::analysis
