#pragma once
// The truth of a rendered stack, site by site.

#include <span>
#include <vector>

#include "data/stack_reader.hpp"
#include "judging/judgement.hpp"
#include "scene/scene.hpp"

namespace atomcam {

/// What a site must be to count as filled: an atom when the exposure began, or still when it ended.
enum class FilledAt { start, end };

/// Of each site: the sites within 1.2 times the smallest distance between sites.
std::vector<std::vector<std::size_t>> neighbours_of(std::span<const Site> sites);

/// [frame, site]. Neighbours are counted by whether they were filled when the exposure began. Throws an Error
/// that names the stack and the frame without truth.
std::vector<SiteTruth> stack_truth(StackReader& stack, std::span<const Site> sites, FilledAt when);

}  // namespace atomcam
