#pragma once
// Photon transfer and linearity after EMVA 1288: variance and mean of evenly lit frames, dark frames taken
// off.

#include <string>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "base/image.hpp"

namespace atomcam {

/// One level of light: means over the pixels.
struct FlatLevel {
  double exposure = 0;  // relative or in seconds; 0: not known
  std::size_t frames = 0;
  double signal_counts = 0;    // above the dark level
  double variance_counts = 0;  // temporal, the dark frames' taken off, the light's own changes taken out
  double variance_error = 0;   // 1 sigma, from blocks of the frame
  double light_noise = 0;      // relative rms of the light from frame to frame
  bool saturated = false;      // the variance falls: not used in the fit
};

struct PhotonTransfer {
  std::vector<FlatLevel> levels;
  /// counts per electron times excess noise factor: slope of variance over signal through the origin.
  double slope = 0, slope_error = 0;
  double linearity_error =
      0;  // EMVA 1288 release 4: mean absolute relative deviation from the line, 5 to 95 %
  double saturation_counts = 0;  // signal of the brightest level that is not saturated
  double chi_square = 0;         // of the slope over levels - 1
};

/// The frames of one level. Changes of the light between frames are taken out: each frame is scaled to the
/// mean level before its variance is taken.
FlatLevel flat_level(const FrameSequence& flats, const FrameSequence& darks, double exposure = 0);
/// The same with a dark level and a dark variance per pixel that are known.
FlatLevel flat_level(const FrameSequence& flats, const std::vector<double>& dark_counts,
                     const std::vector<double>& dark_variance, double exposure = 0);
/// The line through all levels. Throws an Error without a level that has light.
PhotonTransfer photon_transfer(std::vector<FlatLevel> levels);

}  // namespace atomcam
