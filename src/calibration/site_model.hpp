#pragma once
// From a lab to the stack model the battery measures with: where each site's light falls and how to weigh it.

#include "analysis/stack_model.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

/// The stack model of a lab's plain part (its effects are left out), in the pixels of its region.
StackModel stack_model(const Lab& lab);

/// What one atom in a site under test would be measured with.
struct SiteNoise {
  double empty_variance = 0, empty_third = 0;  // cumulants of an empty site's estimate, e
  double variance_per_e = 0, third_per_e = 0;  // added per electron of the atom
};
SiteNoise site_noise(const StackModel& model);

}  // namespace atomcam
