#pragma once
// Rows and columns that stand still at levels of their own, as where a read-out settles at the start of a
// line.

#include <cstdint>
#include <optional>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "calibration/sensor_fit.hpp"

namespace atomcam {

struct LinePattern {
  std::vector<double> rows, columns;  // counts above the mean of all
  double sigma_counts = 0;            // of the sum of both over the frame
};

/// The pattern of a stack without images in it, if it is wider than the temporal noise of a pixel: it would
/// be taken for read noise. A fainter one hardly widens the law of the counts, and may be charge.
std::optional<LinePattern> wide_line_pattern(const StackSums& sums);

/// How often each 16-bit count occurs once the pattern is taken off.
std::vector<std::uint64_t> occurrences_without(const LinePattern& pattern, const FrameSequence& frames);

}  // namespace atomcam
