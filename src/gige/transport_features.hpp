#pragma once
// The features that a GigE Vision device adds to a camera's own: they lie in the bootstrap registers.

#include <vector>

#include "base/feature.hpp"

namespace atomcam::gige {

std::vector<FeatureDeclaration> transport_features(std::uint32_t smallest_packet_bytes,
                                                   std::uint32_t largest_packet_bytes);

}  // namespace atomcam::gige
