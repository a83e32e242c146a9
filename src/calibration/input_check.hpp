#pragma once

#include "calibration/calibrate.hpp"

namespace atomcam {

/// Throws an Error where the stacks do not fit each other or the notes: too few frames (`frames`: those that
/// are used), other shapes, sites outside of the frames.
void check_input(const CalibrationInput& input, std::size_t frames, const Notes& notes);

}  // namespace atomcam
