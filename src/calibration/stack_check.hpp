#pragma once
// Stacks that nothing can be concluded from: clipped, without noise, not what they are said to be.

#include <string_view>

#include "calibration/sensor_fit.hpp"

namespace atomcam {

/// Throws an Error at `place` if values pile up at the largest one, if all frames are the same, or if a tenth
/// of the frames have one value throughout.
void check_stack(const StackSums& sums, std::string_view place);

/// Throws an Error at "darks" if they are brighter than the frames by more than a drift of the baseline.
void check_darks(const StackSums& darks, const StackSums& light);

}  // namespace atomcam
