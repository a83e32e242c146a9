#pragma once
// How long a camera takes for a frame: pure functions of the settings, calibrated to the real cameras'
// figures.

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

struct FrameTiming {
  double readout_s = 0;  // end of the exposure to the last pixel
  double minimum_exposure_s = 0;
  double exposure_step_s = 0;  // exposures are multiples of it; 0: continuous
  bool overlap = false;        // a frame may expose while the one before it is read out

  /// Shortest time from one exposure's start to the next, free running.
  double shortest_interval_s(double exposure_s) const;
  /// The exposure that a camera asked for `exposure_s` makes: the nearest step, not below the minimum.
  double realised_exposure_s(double exposure_s) const;
  bool operator==(const FrameTiming&) const = default;
};

/// EMCCD: the image is shifted into the storage area (one vertical shift per row of the sensor), then every
/// output row is shifted (one vertical shift per binned row), the whole serial register is clocked out at the
/// pixel rate, plus a fixed overhead per output row; rows outside the region are only shifted. Neither the
/// width of the region nor horizontal binning saves time, because the register is emptied in any case. The
/// overhead makes the full frame of an iXon Ultra 897 at 17 MHz and 0.5 us per shift 1/56 s. With frame
/// transfer the exposure runs during the readout of the frame before; without, they follow each other. An
/// exposure shorter than that readout stands for a light pulse of that length at its end: the real camera
/// itself collects light until the readout is over.
FrameTiming emccd_timing(Shape sensor, const CameraSettings& settings, double pixel_rate_hz);

/// qCMOS: rolling readout, 3.6 us per row (standard scan: 8.2944 ms for 2304 rows, 120.56 frames/s) or 86.4
/// us (ultra quiet and photon-number resolving: 199.07 ms, 5.02 frames/s); only the region's height matters,
/// binning is digital. Two rows convert at a time: exposures are multiples of two line times.
FrameTiming qcmos_timing(const CameraSettings& settings, ScanMode scan);

double qcmos_line_time_s(ScanMode scan);

}  // namespace atomcam
