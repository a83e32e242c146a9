#pragma once
// The report of a calibration, one self-contained page: the paper's figures for this data, and the table.

#include <string>

#include "calibration/calibrate.hpp"

namespace atomcam {

/// `input`: what the calibration was made from (its frames are read once more). `command`: how to make it
/// again.
std::string calibration_report(const Calibration& calibration, const CalibrationInput& input,
                               const std::string& command);

/// <table> of notes, fit, error, unit and pull.
std::string parameter_table_markup(const Calibration& calibration);

}  // namespace atomcam
