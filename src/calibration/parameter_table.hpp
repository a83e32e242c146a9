#pragma once
// The table of a calibration: what was noted, what the frames say, with which error.

#include <vector>

#include "calibration/calibrate.hpp"

namespace atomcam {

/// One row for everything the plain model has. What the frames show as a product only (EM gain over electrons
/// per count; rate, transmission and quantum efficiency) is a row of its own, followed by its factors, whose
/// split is from the notes. A note that an experimenter does not make (Zernike terms, pixel maps) is NaN.
std::vector<CalibratedParameter> parameter_table(const Calibration& calibration, const Notes& notes);

}  // namespace atomcam
