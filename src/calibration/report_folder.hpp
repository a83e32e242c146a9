#pragma once
// A calibration's files: report.html, calibration.json and the maps of its pixels.

#include <filesystem>
#include <string>

#include "calibration/calibrate.hpp"

namespace atomcam {

/// Into an existing folder. Maps are float32 [1, row, column], one a file: NumPy reads them, and so does
/// whatever takes a stack. `input` and `command` as for calibration_report().
void write_calibration(const std::filesystem::path& folder, const Calibration& calibration,
                       const CalibrationInput& input, const std::string& command);

}  // namespace atomcam
