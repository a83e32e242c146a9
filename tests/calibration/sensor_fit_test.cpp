// The laws of a sensor's pixels, from dark frames alone.
#include "calibration/sensor_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "calibration/calibrate.hpp"
#include "support/rendered.hpp"

namespace atomcam {
namespace {

// A dozen frames scatter each pixel's variance five times as much as the pixels' own noise differs: what is
// left of the spread after that law is taken off must be right, and know its error.
TEST(SensorFit, ReadNoiseOfAQcmosFromFewDarkFrames) {
  constexpr int frames = 12, sensors = 100;
  Notes notes;
  notes.kind = CameraKind::qcmos;
  notes.shape = {64, 64};
  notes.electrons_per_count = 0.107;
  notes.grid = NotedGrid{.rows = 4, .columns = 4, .spacing_px = 11, .first_x_px = 15, .first_y_px = 15};
  Lab lab = lab_of_notes(notes);
  lab.place_sites();
  auto& sensor = std::get<QcmosDescription>(lab.sensor);
  sensor.read_noise_log_sigma = 0.05;
  sensor.offset_sigma_counts = 0.7;
  const ReadoutMode& mode = sensor.readout_modes.front();
  double noise_pulls = 0, spread_pulls = 0;
  for (int n = 0; n < sensors; ++n) {
    lab.seed = 500 + static_cast<std::uint64_t>(n);
    lab.serial = std::to_string(n);
    const FramesInMemory darks(render(lab, 0, frames, false));
    const QcmosDarkFit fit = fit_qcmos_darks(sum_stack(darks));
    const auto square = [](double v) { return v * v; };
    noise_pulls +=
        square((fit.read_noise_counts - mode.read_noise_e / mode.electrons_per_count) / fit.read_noise_error);
    spread_pulls +=
        square((fit.read_noise_log_sigma - sensor.read_noise_log_sigma) / fit.read_noise_log_sigma_error);
  }
  EXPECT_NEAR(std::sqrt(noise_pulls / sensors), 1.1, 0.25);
  EXPECT_NEAR(std::sqrt(spread_pulls / sensors), 1.2, 0.25);
}

}  // namespace
}  // namespace atomcam
