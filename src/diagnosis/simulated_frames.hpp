#pragma once
// The frames of a simulated stack, as those of a recorded one.

#include <vector>

#include "analysis/frame_sequence.hpp"
#include "diagnosis/chosen_frames.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {

/// Frames of a lab, the shutter open or closed: rendered when visited, kept in memory if they are few.
class SimulatedFrames : public FrameSequence {
 public:
  SimulatedFrames(Lab lab, const FrameChoice& choice, bool shutter_open);
  std::size_t frames() const override { return choice_.count(); }
  Shape shape() const override { return {settings_.output_height(), settings_.output_width()}; }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override;

 private:
  CountImage render(std::size_t n) const;

  Simulation simulation_;
  FrameChoice choice_;
  CameraSettings settings_;
  std::vector<CountImage> kept_;
};

}  // namespace atomcam
