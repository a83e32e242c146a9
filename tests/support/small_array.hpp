#pragma once
// A small array in front of a small EMCCD: notes, and frames of the lab they describe.

#include <vector>

#include "analysis/frame_sequence.hpp"
#include "calibration/notes.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {

inline Notes small_notes() {
  return parse_notes(R"({"camera": "iXon", "shape": [40, 44],
    "settings": {"exposure_s": 0.08, "em_gain": 300, "preamp_e_per_adu": 5, "bias_adu": 200, "read_noise_adu": 4,
                 "cic_e": 0.004, "pixel_um": 16, "magnification": 78.125, "stray_e_per_s": 4, "filling": 0.55,
                 "survival": 0.95},
    "site_grid": {"rows": 3, "cols": 3, "spacing_px": 11, "first_site_px": [10.3, 8.6]}})",
                     "notes");
}

inline FramesInMemory small_frames(const Lab& lab, std::size_t count, bool shutter_open,
                                   std::uint64_t seed = 1) {
  Lab own = lab;
  own.seed = seed;
  const Simulation simulation(std::move(own));
  CameraSettings settings = simulation.lab().settings;
  settings.shutter_open = shutter_open;
  std::vector<CountImage> frames;
  for (std::size_t n = 0; n < count; ++n)
    frames.push_back(simulation.render(n + (shutter_open ? 0 : 100000), settings).counts);
  return FramesInMemory(std::move(frames));
}

}  // namespace atomcam
