#pragma once
// Metrics that no fit has seen, and what atom detectors say: the tables of a diagnosis' report.

#include <string>

#include "diagnosis/second_opinions.hpp"

namespace atomcam::report {

/// Nothing if no second opinion was asked for.
std::string second_opinions_markup(const SecondOpinions& opinions);

}  // namespace atomcam::report
