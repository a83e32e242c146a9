#pragma once
// What a calibration found, as JSON (docs/calibration.md).

#include <nlohmann/json_fwd.hpp>

#include "calibration/calibrate.hpp"

namespace atomcam {

/// {"parameters": [{"key", "unit", "noted", "fitted", "error", "pull", "from_notes"}], "goodness_of_fit",
/// "warnings"}; what there is none of is null.
nlohmann::ordered_json calibration_json(const Calibration& calibration);

}  // namespace atomcam
