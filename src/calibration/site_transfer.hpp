#pragma once
// Photon transfer with atoms in the frames: the variance of what the sites' least-squares fit leaves over,
// against the light there.

#include <cstdint>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"
#include "calibration/site_model.hpp"

namespace atomcam {

/// What is known of the camera and of the mean image before.
struct TransferGround {
  double counts_per_electron = 1;
  double background_e = 0, mean_site_e = 0;  // per pixel; of a site, empty frames included
  std::vector<double> dark_counts;           // per pixel
  std::vector<double> dark_variance_e2;      // per pixel, of one frame
  std::size_t dark_frames = 0;               // that the dark figures of single pixels come from; 0: exact
  std::vector<std::uint8_t> odd;             // pixels to leave out
};

struct SiteTransfer {
  std::vector<float> brightness_e;  // [frame, site], in the model's order
  Leakage leaks;                    // of the sites' light into each other and into the rest
  /// Variance per electron of light in the half of the pixels with less of it, where motion and brightness
  /// noise of the atoms count least; 1 sigma from blocks of frames and from the dark figures.
  double variance_per_e = 0, error = 0;
};

/// Variance that a figure of whole frames has beyond the `due` one of their pixels' own noise; 0 unless it is
/// clear that there is more.
double drift_variance(const std::vector<double>& frames, double due);

/// `model`: of the frames, with the figures of `ground`; `point_spread`: that of its images.
SiteTransfer site_transfer(const FrameSequence& frames, const StackModel& model,
                           const PointSpreadFunction& point_spread, const TransferGround& ground);

}  // namespace atomcam
