#pragma once
// A lab at work: frame number n with its truth. The only place where the stages meet.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "simulation/lab.hpp"

namespace atomcam {

/// What is true of one frame. Positions in sensor pixels.
struct AtomTruth {
  int site = 0;
  double x_px = 0, y_px = 0;
  bool present_at_start = false, present_at_end = false;
  double loss_time_s = never;
  double photons_emitted = 0;      // expected over its life in the exposure, into 4 pi
  std::int64_t electrons_detected = 0;  // photo-electrons of this atom in the region
};

struct FrameTruth {
  std::uint64_t frame = 0;
  std::uint64_t seed = 0;
  std::vector<AtomTruth> atoms;    // one per site
  double shift_x_px = 0, shift_y_px = 0;
  /// Compact JSON; the ground-truth chunk and the files beside rendered stacks hold this.
  std::string to_json() const;
};

struct Frame {
  CountImage counts;
  FrameTruth truth;
};

class Simulation {
 public:
  explicit Simulation(Lab lab);
  ~Simulation();
  const Lab& lab() const;
  const Sensor& sensor() const;

  /// Frame `number`; pure and thread safe. Rows are shared out over `threads` (the bits do not depend on it).
  Frame render(std::uint64_t number, const CameraSettings& settings, int threads = 1) const;
  Frame render(std::uint64_t number) const { return render(number, lab().settings); }
  /// Expected photo-electrons per output pixel of that frame (atoms at their drawn lives, stray light; no dark).
  PhotonImage expected_electrons(std::uint64_t number, const CameraSettings& settings) const;

 private:
  struct State;
  std::shared_ptr<const State> state_for(const CameraSettings& settings) const;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace atomcam
