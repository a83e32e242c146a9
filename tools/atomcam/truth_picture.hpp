#pragma once
// A frame beside its ground truth, for human eyes.

#include "atomcam/truth_check.hpp"
#include "data/canvas.hpp"

namespace atomcam {

/// Left the counts around the sites; right what is true: every site, the atoms that stay, the atoms that are
/// lost.
Canvas truth_picture(const CountImage& counts, const FrameAtoms& truth, const Lab& lab,
                     const StackSettings& settings);

}  // namespace atomcam
