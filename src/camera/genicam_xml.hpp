#pragma once
// The GenICam description of a camera, written from its table of features. Follows GenApi schema 1.1.

#include <span>
#include <string>

#include "camera/register_map.hpp"

namespace atomcam {

std::string genicam_xml(const CameraModel& model, const std::vector<Feature>& features,
                        const RegisterMap& map, std::span<const FeatureDeclaration> transport_features);

}  // namespace atomcam
