#include "simulation/exposure.hpp"

#include <algorithm>

namespace atomcam {

double ExposureWindow::overlap_s(int row, double begin_s, double end_s) const {
  const double opens = pulsed ? light_begin_s : row_begin_s(row);
  const double closes = pulsed ? light_end_s : row_begin_s(row) + exposure_s;
  return std::max(0.0, std::min(closes, end_s) - std::max(opens, begin_s));
}

ExposureWindow exposure_window(const CameraSettings& settings, double line_time_s) {
  const double roll_s = line_time_s * std::max(0, settings.region.height - 1);
  ExposureWindow window{.exposure_s = settings.exposure_s,
                        .row_delay_s = line_time_s,
                        .light_begin_s = 0,
                        .light_end_s = settings.exposure_s + roll_s,
                        .pulsed = settings.pulsed_light && line_time_s > 0};
  if (window.pulsed) {
    window.light_begin_s = roll_s;
    window.light_end_s = std::max(roll_s, settings.exposure_s);
  }
  return window;
}

}  // namespace atomcam
