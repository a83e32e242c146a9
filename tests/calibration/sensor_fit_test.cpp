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
  double noise_pulls = 0, spread_pulls = 0, square_pull = 0;
  int below_zero = 0;
  for (int n = 0; n < sensors; ++n) {
    lab.seed = 500 + static_cast<std::uint64_t>(n);
    lab.serial = std::to_string(n);
    const FramesInMemory darks(render(lab, 0, frames, false));
    const QcmosDarkFit fit = fit_qcmos_darks(sum_stack(darks));
    const auto square = [](double v) { return v * v; };
    noise_pulls +=
        square((fit.read_noise_counts - mode.read_noise_e / mode.electrons_per_count) / fit.read_noise_error);
    const Spread& spread = fit.read_noise_log_sigma;
    spread_pulls += square((spread.value() - sensor.read_noise_log_sigma) / spread.error());
    square_pull += (spread.square - square(sensor.read_noise_log_sigma)) / spread.error_of_square / sensors;
    below_zero += spread.square < 0;
  }
  EXPECT_NEAR(std::sqrt(noise_pulls / sensors), 1.1, 0.25);
  EXPECT_NEAR(std::sqrt(spread_pulls / sensors), 1.2, 0.25);
  EXPECT_NEAR(square_pull, 0, 0.6);
  EXPECT_GT(below_zero, 3);  // as chance will have it
}

// A pixel that two rays hit hides them behind its own variance; a site that is filled now and then stays.
TEST(SensorFit, StrikesAreLeftOutAndAtomsAreNot) {
  constexpr int frames = 60;
  constexpr double gain = 10;  // counts per electron
  std::vector<CountImage> stack;
  for (int n = 0; n < frames; ++n) {
    CountImage frame(Shape{2, 3});
    for (std::uint16_t& count : frame.pixels()) count = static_cast<std::uint16_t>(200 + (n * 7) % 5);
    if (n % 12 == 3) frame(0, 1) += 60 * gain;  // an atom
    stack.push_back(std::move(frame));
  }
  const StackSums clean = sum_stack(FramesInMemory(stack));
  stack[17](1, 2) += 300 * gain;
  stack[40](1, 2) += 350 * gain;
  const FramesInMemory struck(stack);
  const StackSums found = sum_stack_without_strikes(struck, gain);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(found.mean(i), clean.mean(i), i == 5 ? 0.1 : 1e-9) << i;
    EXPECT_NEAR(found.variance(i), clean.variance(i), i == 5 ? 0.1 : 1e-6) << i;
  }
  for (std::size_t n = 0; n < frames; ++n) EXPECT_NEAR(found.frame_mean[n], clean.frame_mean[n], 20) << n;
  EXPECT_GT(sum_stack(struck).variance(5), 1000 * found.variance(5));
}

}  // namespace
}  // namespace atomcam
