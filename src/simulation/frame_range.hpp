#pragma once
// Many frames into memory of the caller: counts and truth as plain arrays, the form in which other languages
// hold them.

#include <cstdint>
#include <functional>
#include <span>

#include "simulation/simulation.hpp"

namespace atomcam {

/// Where the truth of a range of frames goes, row-major. Members and units as in AtomTruth and FrameTruth;
/// null: not wanted.
struct TruthArrays {
  // [frame, site]
  std::uint8_t* present_at_start = nullptr;  // 0 or 1
  std::uint8_t* present_at_end = nullptr;    // 0 or 1
  double* x_px = nullptr;
  double* y_px = nullptr;
  double* loss_time_s = nullptr;  // infinity: not lost
  double* photons_emitted = nullptr;
  double* electrons_expected = nullptr;
  std::int64_t* electrons_detected = nullptr;
  // [frame]
  double* shift_x_px = nullptr;
  double* shift_y_px = nullptr;
  double* background_e = nullptr;
};

struct FrameRange {
  std::uint64_t first = 0;
  std::uint64_t count = 0;
};

/// Renders the range straight into `counts`, [frame, row, column]. Whole frames side by side on `threads`
/// threads (0: all cores); few frames share out their rows instead; the bits do not depend on it. `poll`, if
/// any, is called now and then on the calling thread; what it throws ends the work.
void render_frames(const Simulation& simulation, const CameraSettings& settings, FrameRange range,
                   std::span<std::uint16_t> counts, const TruthArrays& truth, int threads,
                   const std::function<void()>& poll = {});

}  // namespace atomcam
