#pragma once
// Real, plain and fixed beside each other, as markup.

#include <string>

#include "diagnosis/report.hpp"

namespace atomcam::report {

/// The `telling` curves that differ most from the plain model; the others folded away.
std::string curves(const ReportProfiles& profiles, std::size_t telling);

/// Every map: real, plain, fixed, on one scale; and what is left of the mean site.
std::string maps(const ReportProfiles& profiles);

}  // namespace atomcam::report
