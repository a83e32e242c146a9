#include <gtest/gtest.h>

#include <cmath>

#include "sensor/sensor.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::moments;
using statistics::sigmas;

EmccdDescription quiet_emccd(double read_noise_e = 0) {
  EmccdDescription description;
  description.shape = {128, 128};
  description.dark_rate_e_per_s = 0;
  description.clock_induced_charge_e = 0;
  description.readout_modes = {
      {Amplifier::electron_multiplying, ScanMode::standard, 17e6, "1x", 4.11, read_noise_e},
      {Amplifier::conventional, ScanMode::standard, 3e6, "1x", 3.8, read_noise_e}};
  return description;
}

CameraSettings whole(Shape shape) {
  CameraSettings settings;
  settings.region = {0, 0, shape.columns, shape.rows};
  return settings;
}

CountImage read(const Sensor& sensor, const CameraSettings& settings, const SensorLight& light,
                std::uint64_t frame = 0) {
  const auto readout = sensor.begin(settings, light, 11, frame);
  CountImage image(readout->plane_shape());
  for (int r = 0; r < image.rows(); ++r) readout->read_row(r, image.row(r));
  return readout->finish(std::move(image));
}

TEST(Emccd, MeanCountsAreBiasPlusLightWithoutAnOffset) {
  // A known defect of a predecessor: counts cut to integers, half a count too low.
  const auto sensor = make_emccd(quiet_emccd(30), "A");
  for (const double light_e : {0.0, 0.3, 4.0, 200.0}) {
    for (const int mode : {0, 1}) {
      CameraSettings settings = whole(sensor->shape());
      settings.readout_mode = mode;
      settings.em_gain = 10;
      SensorLight light;
      light.background_e = light_e;
      const auto m = moments(read(*sensor, settings, light).pixels());
      const double gain = mode == 0 ? 10 : 1, e_per_count = mode == 0 ? 4.11 : 3.8;
      EXPECT_LT(sigmas(m.mean, 200 + gain * light_e / e_per_count, m.mean_error()), 5)
          << light_e << " e, mode " << mode;
    }
  }
}

}  // namespace
}  // namespace atomcam
