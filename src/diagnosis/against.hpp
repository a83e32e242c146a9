#pragma once
// A real stack against another real one: before and after a change of the set-up, one half of the dark frames
// against the other.

#include "diagnosis/diagnosis.hpp"

namespace atomcam {

/// "no_gap" or "unexplained": the battery's differences between the stacks, in standard deviations of such
/// differences between simulated stacks of one and the same sensor, or between halves of the stacks,
/// whichever is larger. `darks` serve the calibration, which is that of both stacks together. Effects are not
/// looked for. Throws Error for stacks that cannot be compared.
Diagnosis diagnose_against(const Notes& notes, const FrameSequence& frames, const FrameSequence& against,
                           const FrameSequence* darks, const DiagnosisOptions& options);

}  // namespace atomcam
