#pragma once
// A series with one value a frame: what an undisturbed one would not do.

#include <span>

#include "analysis/family.hpp"

namespace atomcam::analysis {

/// Puts variance (log), correlations at one and five frames, steps (log), trend, curvature, largest jump,
/// first frames, largest peak of the periodogram, odd against even frames, each under `name`. Frames outside
/// `which` and values that are no numbers are left out; `white` is the variance that noise alone gives (or
/// 1).
void put_series(Sheet& sheet, std::string_view name, std::span<const double> values, const Record& record,
                Part which, double white = 1);

/// Coarse: variance, correlation at one frame, trend, curvature.
void put_short_series(Sheet& sheet, std::string_view name, std::span<const double> values,
                      const Record& record, Part which, double white = 1);

}  // namespace atomcam::analysis
