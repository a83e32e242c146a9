#pragma once
// Frames of a lab, in memory.

#include <cstdint>
#include <vector>

#include "simulation/simulation.hpp"

namespace atomcam {

inline std::vector<CountImage> render(const Lab& lab, std::uint64_t first, int frames, bool shutter_open) {
  const Simulation simulation(lab);
  CameraSettings settings = simulation.lab().settings;
  settings.shutter_open = shutter_open;
  std::vector<CountImage> stack;
  for (int n = 0; n < frames; ++n)
    stack.push_back(simulation.render(first + static_cast<std::uint64_t>(n), settings).counts);
  return stack;
}

}  // namespace atomcam
