#pragma once
// Runs something once per instruction set that this build has loops for and this machine can execute.

#include <hwy/targets.h>

#include "base/instruction_sets.hpp"

namespace atomcam {

template <class Run>
void on_every_instruction_set(Run run) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    run(hwy::TargetName(target));
  }
  hwy::SetSupportedTargetsForTest(0);
}

}  // namespace atomcam
