#pragma once
// When each row of a sensor is open to light, and when the imaging light is on.

#include "base/camera_settings.hpp"

namespace atomcam {

/// All times in seconds since the first row of the region opened.
struct ExposureWindow {
  double exposure_s = 0;     // of every row
  double row_delay_s = 0;    // row r (counted in physical rows of the region) opens r * row_delay_s later
  double light_begin_s = 0;  // the imaging light is on in [light_begin_s, light_end_s)
  double light_end_s = 0;

  double light_s() const { return light_end_s - light_begin_s; }
  double row_begin_s(int row) const { return row * row_delay_s; }
  /// How long row `row` sees light that is on in [begin_s, end_s).
  double overlap_s(int row, double begin_s, double end_s) const;
  bool global() const { return row_delay_s == 0 || pulsed; }
  bool pulsed = false;  // light only while every row is open
};

/// EMCCD (`line_time_s` = 0): all rows open together. qCMOS: a rolling shutter; pulsed light is on only while
/// all rows of the region are open (not at all if the exposure is shorter than the shutter takes to roll over
/// it), continuous light from the opening of the first row to the closing of the last.
ExposureWindow exposure_window(const CameraSettings& settings, double line_time_s);

}  // namespace atomcam
