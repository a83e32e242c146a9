#include "camera/timing.hpp"

#include <algorithm>
#include <cmath>

namespace atomcam {

namespace {

// iXon Ultra 897: 512 rows of 512 pixels at 17 MHz and 0.5 us per vertical shift take 1/56 s.
constexpr double ixon_rows = 512;
constexpr double ixon_full_frame_s = 1.0 / 56.0;
constexpr double ixon_shift_s = 0.5e-6;
constexpr double ixon_row_overhead_s =
    (ixon_full_frame_s - ixon_rows * ixon_shift_s) / ixon_rows - ixon_shift_s - ixon_rows / 17e6;

constexpr double emccd_minimum_exposure_s = 10e-6;

}  // namespace

double FrameTiming::shortest_interval_s(double exposure_s) const {
  return overlap ? std::max(exposure_s, readout_s) : exposure_s + readout_s;
}

double FrameTiming::realised_exposure_s(double exposure_s) const {
  if (exposure_step_s > 0) exposure_s = std::round(exposure_s / exposure_step_s) * exposure_step_s;
  return std::max(exposure_s, minimum_exposure_s);
}

FrameTiming emccd_timing(Shape sensor, const CameraSettings& settings, double pixel_rate_hz) {
  const double rows = settings.output_height();
  const double discarded = sensor.rows - settings.region.height;
  const double shift_s = settings.vertical_shift_s;
  const double row_s = settings.binning_y * shift_s + ixon_row_overhead_s + sensor.columns / pixel_rate_hz;
  FrameTiming timing;
  timing.readout_s = sensor.rows * shift_s + discarded * shift_s + rows * row_s;
  timing.overlap = settings.frame_transfer;
  timing.minimum_exposure_s = emccd_minimum_exposure_s;
  return timing;
}

double qcmos_line_time_s(ScanMode scan) {
  return scan == ScanMode::standard ? 3.6e-6 : 86.4e-6;
}

FrameTiming qcmos_timing(const CameraSettings& settings, ScanMode scan) {
  const double line_s = qcmos_line_time_s(scan);
  FrameTiming timing;
  timing.readout_s = settings.region.height * line_s;
  timing.overlap = true;
  timing.minimum_exposure_s = 2 * line_s;
  timing.exposure_step_s = 2 * line_s;
  return timing;
}

}  // namespace atomcam
