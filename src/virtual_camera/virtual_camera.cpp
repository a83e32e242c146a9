#include "virtual_camera/virtual_camera.hpp"

#include <utility>

#include "virtual_camera/camera_model.hpp"
#include "virtual_camera/frame_sources.hpp"

namespace atomcam {

VirtualCamera::VirtualCamera(Lab lab, VirtualCameraOptions options)
    : simulation_(std::make_shared<const Simulation>(std::move(lab))) {
  std::shared_ptr<FrameSource> source = std::make_shared<LiveFrames>(simulation_);
  if (options.replay_frames > 0)
    source = std::make_shared<RepeatedFrames>(std::move(source), options.replay_frames);
  camera_ = Camera::open(camera_model(this->lab(), options.render_threads), std::move(source),
                         simulation_controls(this->lab()));
  device_ = std::make_unique<gige::Device>(*camera_, std::move(options.device));
}

}  // namespace atomcam
