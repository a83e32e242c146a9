#pragma once
// Where the fit of a histogram of counts starts.

#include <cstdint>
#include <vector>

#include "calibration/count_law.hpp"

namespace atomcam {

struct CountStart {
  double bias_counts = 0, read_noise_counts = 1;
};
/// Mode and left-hand width of a histogram. `occurrences` of each 16-bit count; `noted_noise` where nothing
/// lies below the mode.
CountStart count_start(const std::vector<std::uint64_t>& occurrences, double noted_noise);

/// The part of the histogram that a fit reads: nine read noises about the bias and, above, the tail of the
/// first electrons.
CountHistogram histogram_about(const std::vector<std::uint64_t>& occurrences, const CountStart& start,
                               double counts_per_electron);

}  // namespace atomcam
