#pragma once

#include <span>

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

/// The mode the settings name; an Error if there is none.
const ReadoutMode& readout_mode_of(const CameraSettings& settings, std::span<const ReadoutMode> modes);
/// An Error unless the region lies on the sensor and is a multiple of the binning.
void check_region(const CameraSettings& settings, Shape sensor);

}  // namespace atomcam
