#pragma once
// The report's curves and maps of simulated stacks, kept for the next report on the same frames.

#include <functional>

#include "data/kept_results.hpp"
#include "diagnosis/profiles.hpp"

namespace atomcam {

/// What `simulate` gives, or gave before under the same key: profiles of `stacks` stacks that are measured as
/// `like` was. `kept`: null to simulate in any case.
std::vector<Profiles> kept_profiles(const KeptResults* kept, const ResultKey& key, const Profiles& like,
                                    int stacks, const std::function<std::vector<Profiles>()>& simulate);

}  // namespace atomcam
