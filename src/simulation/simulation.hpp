#pragma once
// A lab at work: frame number n with its truth. The only place where the stages meet.

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "simulation/lab.hpp"

namespace atomcam {

/// What is true of one site's atom in one frame. Positions in physical sensor pixels, where the geometric
/// image of the atom stands (aberrations with a centroid of their own, such as coma, come on top).
struct AtomTruth {
  int site = 0;
  double x_px = 0;
  double y_px = 0;
  bool present_at_start = false;
  bool present_at_end = false;
  double loss_time_s = never;           // since the exposure began; `never` if it survives
  double photons_emitted = 0;           // expected over its life in the exposure, into 4 pi
  double electrons_expected = 0;        // photo-electrons if the whole sensor plane were counted
  std::int64_t electrons_detected = 0;  // photo-electrons in the region
};

struct FrameTruth {
  std::uint64_t frame = 0;
  std::uint64_t seed = 0;
  double shift_x_px = 0;  // of the whole image in this frame (already in the atoms' positions)
  double shift_y_px = 0;
  double background_e = 0;       // mean photo-electrons of stray light per physical pixel
  std::vector<AtomTruth> atoms;  // one per site, in site order
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
  /// Shares with `previous` what is dear to make and the same in both: the sensor's maps, the point-spread
  /// functions.
  Simulation(Lab lab, const Simulation& previous);
  ~Simulation();
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;

  const Lab& lab() const;
  const Sensor& sensor() const;

  /// Frame `number` under `settings`; pure and thread safe. Emitters and rows are shared out over `threads`;
  /// the bits do not depend on it. Throws Error for settings the sensor cannot have (region, binning, readout
  /// mode, override).
  Frame render(std::uint64_t number, const CameraSettings& settings, int threads = 1) const;
  Frame render(std::uint64_t number) const { return render(number, lab().settings); }
  /// The same frame into the caller's memory, [row, column] of output_height() x output_width() pixels.
  FrameTruth render_into(std::span<std::uint16_t> counts, std::uint64_t number,
                         const CameraSettings& settings, int threads = 1) const;

  /// Expected photo-electrons per output pixel of that frame: its atoms at their drawn lives and its stray
  /// light, with the effects of the planes scene and photons; no dark current, no clock-induced charge.
  PhotonImage expected_electrons(std::uint64_t number, const CameraSettings& settings) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace atomcam
