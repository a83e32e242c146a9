#pragma once
// Runs something once per instruction set that this build has loops for and this machine can execute.

#include "base/instruction_sets.hpp"
// First the choice of instruction sets, then what looks at it.
#include <hwy/targets.h>

namespace atomcam {

/// Returns on how many.
template <class Run>
int on_every_instruction_set(Run run) {
  int count = 0;
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    run(hwy::TargetName(target));
    ++count;
  }
  hwy::SetSupportedTargetsForTest(0);
  return count;
}

}  // namespace atomcam
