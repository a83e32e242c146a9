#pragma once
// What a lab tells the camera layer: the camera's model, and the lab's live parameters as controls.

#include <vector>

#include "camera/camera.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

CameraModel camera_model(const Lab& lab, int render_threads);

/// Every live scalar of the lab as a feature of the category SimulationControl. Zernike terms share one
/// feature, SimZernikeCoefficient, chosen by SimZernikeSelector.
std::vector<SourceControl> simulation_controls(const Lab& lab);

}  // namespace atomcam
