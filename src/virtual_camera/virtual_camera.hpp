#pragma once
// A camera, its simulation and its place on the network, all from one lab.

#include <memory>
#include <string>

#include "camera/camera.hpp"
#include "gige/device.hpp"
#include "simulation/lab.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {

struct VirtualCameraOptions {
  gige::DeviceOptions device;  // address, faults, packet size
  int render_threads = 1;      // frames rendered at a time, ahead of their exposure
  int replay_frames = 0;       // > 0: that many frames are rendered once and shown again and again
};

class VirtualCamera {
 public:
  VirtualCamera(Lab lab, VirtualCameraOptions options);

  Camera& camera() { return *camera_; }
  gige::Device& device() { return *device_; }
  const Lab& lab() const { return simulation_->lab(); }

 private:
  std::shared_ptr<const Simulation> simulation_;
  std::unique_ptr<Camera> camera_;
  std::unique_ptr<gige::Device> device_;
};

}  // namespace atomcam
