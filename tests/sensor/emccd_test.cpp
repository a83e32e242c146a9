#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "base/error.hpp"
#include "sensor/frames.hpp"
#include "sensor/register_law.hpp"
#include "support/instruction_sets.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::moments;
using statistics::sigmas;

constexpr double e_per_count = 4.11;

/// Nothing but light, and one electron per count: counts are electrons.
EmccdDescription plain_emccd(double read_noise_e = 0, double electrons_per_count = 1) {
  EmccdDescription description;
  description.shape = {128, 160};
  description.dark_rate_e_per_s = 0;
  description.clock_induced_charge_e = 0;
  description.readout_modes = {
      {Amplifier::electron_multiplying, ScanMode::standard, 17e6, "1x", electrons_per_count, read_noise_e},
      {Amplifier::conventional, ScanMode::standard, 3e6, "1x", electrons_per_count, read_noise_e}};
  return description;
}

EmccdDescription noisy_emccd() {
  EmccdDescription description = plain_emccd(30, e_per_count);
  description.dark_rate_e_per_s = 0.1;
  description.clock_induced_charge_e = 0.02;
  return description;
}

TEST(Emccd, MeanCountsAreBiasPlusLightWithoutAnOffset) {
  // A known defect of a predecessor: counts cut to integers, half a count too low.
  const auto sensor = make_emccd(plain_emccd(30, e_per_count), "A");
  for (const double light_e : {0.0, 0.3, 4.0, 200.0}) {
    for (const int mode : {0, 1}) {
      CameraSettings settings = whole(*sensor);
      settings.readout_mode = mode;
      settings.em_gain = 10;
      std::vector<double> counts;
      for (std::uint64_t frame = 0; frame < 10; ++frame) {
        const CountImage image = read(*sensor, settings, uniform_light(light_e), frame);
        counts.insert(counts.end(), image.pixels().begin(), image.pixels().end());
      }
      const auto m = moments(counts);
      const double gain = mode == 0 ? 10 : 1;
      EXPECT_LT(sigmas(m.mean, 200 + gain * light_e / e_per_count, m.mean_error()), 5)
          << light_e << " e, mode " << mode;
    }
  }
}

TEST(Emccd, DarkFrameIsBiasAndReadNoise) {
  const auto sensor = make_emccd(plain_emccd(30, e_per_count), "A");
  const auto m = moments(read(*sensor, whole(*sensor), {}).pixels());
  const double variance = std::pow(30 / e_per_count, 2) + 1.0 / 12;
  EXPECT_LT(sigmas(m.mean, 200, m.mean_error()), 5);
  EXPECT_LT(sigmas(m.variance(), variance, m.variance_error()), 5);
}

TEST(Emccd, ConventionalAmplifierAndGainOneAddNoMultiplicationNoise) {
  const auto sensor = make_emccd(plain_emccd(), "A");
  for (const int mode : {0, 1}) {
    CameraSettings settings = whole(*sensor);
    settings.readout_mode = mode;
    settings.em_gain = mode == 0 ? 1 : 300;  // the conventional amplifier ignores it
    for (const double light_e : {0.5, 50.0}) {
      const auto m = moments(read(*sensor, settings, uniform_light(light_e)).pixels());
      EXPECT_LT(sigmas(m.mean, 200 + light_e, m.mean_error()), 5);
      EXPECT_LT(sigmas(m.variance(), light_e, m.variance_error()), 5);
    }
  }
}

TEST(Emccd, VarianceCarriesTheExcessNoiseOfTheCascade) {
  const auto sensor = make_emccd(plain_emccd(0, 20), "A");
  for (const double gain : {2.0, 10.0, 300.0}) {
    CameraSettings settings = whole(*sensor);
    settings.em_gain = gain;
    const auto m = moments(read(*sensor, settings, uniform_light(20)).pixels());
    const double f2 = 2 * (gain - 1) * std::pow(gain, -537.0 / 536) + 1 / gain;
    const double expected = f2 * 20 * gain * gain / 400 + 1.0 / 12;
    EXPECT_LT(sigmas(m.variance(), expected, m.variance_error()), 5) << gain;
    EXPECT_LT(sigmas(m.mean, 200 + gain * 20 / 20, m.mean_error()), 5) << gain;
  }
}

TEST(Emccd, FusedRowsGiveTheBitsOfTheSteps) {
  const auto sensor = make_emccd(noisy_emccd(), "A");
  SensorLight light = one_pixel(sensor->shape(), 60, 70, 900);
  light.background_e = 0.4;
  for (const double gain : {1.0, 2.0, 300.0}) {
    for (const int mode : {0, 1}) {
      CameraSettings settings = whole(*sensor);
      settings.em_gain = gain;
      settings.readout_mode = mode;
      EXPECT_EQ(read(*sensor, settings, light, 3), read_in_steps(*sensor, settings, light, 3));
    }
  }
}

TEST(Emccd, SameBitsOnEveryInstructionSet) {
  const auto sensor = make_emccd(noisy_emccd(), "A");
  CameraSettings settings = whole(*sensor);
  settings.region = {8, 4, 91, 50};  // rows that no vector divides
  SensorLight light = one_pixel({50, 91}, 20, 90, 900);
  light.background_e = 0.4;
  std::vector<CountImage> images;
  on_every_instruction_set([&](const char*) { images.push_back(read(*sensor, settings, light)); });
  for (const CountImage& image : images) EXPECT_EQ(image, images.front());
  EXPECT_GE(images.size(), 1u);
}

TEST(Emccd, SameBitsFromSeveralThreads) {
  const auto sensor = make_emccd(noisy_emccd(), "A");
  const SensorLight light = uniform_light(0.4);
  const CameraSettings settings = whole(*sensor);
  const CountImage expected = read(*make_emccd(noisy_emccd(), "A"), settings, light);
  const auto readout = sensor->begin(settings, light, 11, 0);
  CountImage counts(readout->plane_shape());
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int r = t; r < counts.rows(); r += 4) readout->read_row(r, counts.row(r));
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(counts, expected);
}

TEST(Emccd, FramesAndSeedsDiffer) {
  const auto sensor = make_emccd(noisy_emccd(), "A");
  const CameraSettings settings = whole(*sensor);
  const CountImage first = read(*sensor, settings, uniform_light(1), 0, 1);
  EXPECT_EQ(first, read(*sensor, settings, uniform_light(1), 0, 1));
  EXPECT_NE(first, read(*sensor, settings, uniform_light(1), 1, 1));
  EXPECT_NE(first, read(*sensor, settings, uniform_light(1), 0, 2));
}

TEST(Emccd, BinsOnTheChipBeforeNoise) {
  EmccdDescription description = plain_emccd(30, e_per_count);
  description.dark_rate_e_per_s = 2;
  description.clock_induced_charge_e = 0.3;
  const auto sensor = make_emccd(description, "A");
  CameraSettings settings = whole(*sensor);
  settings.readout_mode = 1;
  settings.exposure_s = 0.5;
  settings.binning_x = 4;
  settings.binning_y = 2;
  std::vector<double> counts;
  for (std::uint64_t frame = 0; frame < 20; ++frame) {
    const CountImage image = read(*sensor, settings, uniform_light(5), frame);
    ASSERT_EQ(image.shape(), (Shape{64, 40}));
    counts.insert(counts.end(), image.pixels().begin(), image.pixels().end());
  }
  const auto m = moments(counts);
  const double electrons = 8 * (5 + 2 * 0.5 + 0.3);  // eight pixels' charge, one readout's noise
  EXPECT_LT(sigmas(m.mean, 200 + electrons / e_per_count, m.mean_error()), 5);
  EXPECT_LT(
      sigmas(m.variance(), (electrons + 900) / (e_per_count * e_per_count) + 1.0 / 12, m.variance_error()),
      5);
}

TEST(Emccd, WellsClipBeforeTheConverter) {
  EmccdDescription description = plain_emccd(0, 20);
  const auto sensor = make_emccd(description, "A");
  CameraSettings settings = whole(*sensor);
  settings.em_gain = 1;
  EXPECT_EQ(read(*sensor, settings, uniform_light(1e6)).pixels()[0], 200 + 180000 / 20);
  settings.binning_x = 2;  // two pixels' wells
  EXPECT_EQ(read(*sensor, settings, uniform_light(1e6)).pixels()[0], 200 + 360000 / 20);
  settings.binning_y = 4;  // eight pixels hold more than the register
  EXPECT_EQ(read(*sensor, settings, uniform_light(1e6)).pixels()[0], 200 + 800000 / 20);
  settings.binning_x = settings.binning_y = 1;
  settings.em_gain = 300;
  EXPECT_EQ(read(*sensor, settings, uniform_light(1e5)).pixels()[0], 200 + 800000 / 20);
}

TEST(Emccd, ConverterSaturates) {
  // A known defect of a predecessor: counts beyond 16 bits.
  const auto sensor = make_emccd(plain_emccd(0, 4.11), "A");
  CameraSettings settings = whole(*sensor);
  settings.em_gain = 300;
  const CountImage saturated1 = read(*sensor, settings, uniform_light(1e5));
  for (const std::uint16_t count : saturated1.pixels()) ASSERT_EQ(count, 65535);
  settings.bias_counts = 0;
  const auto noisy = make_emccd(plain_emccd(30, 4.11), "A");
  std::int64_t zeros = 0;
  const CountImage saturated2 = read(*noisy, settings, {});
  for (const std::uint16_t count : saturated2.pixels()) zeros += count == 0;
  const double n = static_cast<double>(noisy->shape().pixels());
  const double p = 0.5 * std::erfc(-0.5 / (30 / 4.11) / std::sqrt(2.0));  // everything below half a count
  EXPECT_LT(sigmas(static_cast<double>(zeros), n * p, std::sqrt(n * p * (1 - p))), 5);
}

TEST(Emccd, DarkCurrentFollowsTheTemperature) {
  EmccdDescription description = plain_emccd();
  description.dark_rate_e_per_s = 1;
  const auto sensor = make_emccd(description, "A");
  for (const double temperature_c : {-100.0, -80.0, -60.0}) {
    CameraSettings settings = whole(*sensor);
    settings.em_gain = 1;
    settings.exposure_s = 30;
    settings.sensor_temperature_c = temperature_c;
    const auto m = moments(read(*sensor, settings, {}).pixels());
    const double expected = 30 * std::exp(-1372.8 * (1 / (temperature_c + 273.15) - 1 / 193.15));
    EXPECT_LT(sigmas(m.mean - 200, expected, std::sqrt(expected / m.count)), 5) << temperature_c;
  }
}

TEST(Emccd, AtomsLandWhereTheyAreSaidTo) {
  const auto sensor = make_emccd(plain_emccd(), "A");
  CameraSettings settings = whole(*sensor);
  settings.em_gain = 1;
  const CountImage image = read(*sensor, settings, one_pixel(sensor->shape(), 17, 23, 1234));
  for (int r = 0; r < image.rows(); ++r)
    for (int c = 0; c < image.columns(); ++c) ASSERT_EQ(image(r, c), 200 + (r == 17 && c == 23 ? 1234 : 0));
}

TEST(Emccd, SerialChargeAddsTheCascadesShare) {
  const auto sensor = make_emccd(plain_emccd(), "A");
  CameraSettings settings = whole(*sensor);
  settings.em_gain = 300;
  const double p = std::pow(300.0, 1.0 / 536) - 1;
  std::vector<double> output;
  const SensorLight none;
  for (std::uint64_t frame = 0; frame < 20; ++frame) {
    const auto readout = sensor->begin(settings, none, 1, frame);
    std::vector<float> row(160);
    for (int r = 0; r < 128; ++r) {
      std::fill(row.begin(), row.end(), 0.0f);
      readout->add_serial_clock_induced_charge(r, 0.0107, row);
      output.insert(output.end(), row.begin(), row.end());
    }
  }
  const auto m = moments(output);
  EXPECT_LT(sigmas(m.mean, 0.0107 * 299 / (536 * p), m.mean_error()), 5);
  const double hit =
      static_cast<double>(std::count_if(output.begin(), output.end(), [](double o) { return o > 0; }));
  const double expected = -std::expm1(-0.0107);
  EXPECT_LT(sigmas(hit / m.count, expected, std::sqrt(expected / m.count)), 5);
  settings.readout_mode = 1;  // the conventional amplifier has no register
  std::vector<float> row(160, 0.0f);
  sensor->begin(settings, none, 1, 0)->add_serial_clock_induced_charge(0, 100, row);
  EXPECT_EQ(row, std::vector<float>(160, 0.0f));
}

TEST(Emccd, BackgroundMapGivesEveryPixelItsOwnMean) {
  EmccdDescription description = plain_emccd();
  description.clock_induced_charge_e = 0.1;
  const auto sensor = make_emccd(description, "A");
  auto ratio = std::make_shared<RatioMap>(sensor->shape());
  for (int r = 0; r < ratio->rows(); ++r)
    for (int c = 0; c < ratio->columns(); ++c)
      (*ratio)(r, c) = static_cast<float>(c / 40) * 0.5f;  // 0 to 1.5
  CameraSettings settings = whole(*sensor);
  settings.em_gain = 1;
  for (const double light_e : {0.3, 4.0, 100.0}) {  // thinned, and drawn one by one
    SensorLight light = uniform_light(light_e);
    light.background_ratio = ratio;
    std::vector<std::vector<double>> bands(4);
    for (std::uint64_t frame = 0; frame < 5; ++frame) {
      const CountImage image = read(*sensor, settings, light, frame);
      for (int r = 0; r < image.rows(); ++r)
        for (int c = 0; c < image.columns(); ++c)
          bands[static_cast<std::size_t>(c / 40)].push_back(image(r, c));
    }
    for (std::size_t band = 0; band < 4; ++band) {
      const auto m = moments(bands[band]);
      const double mean = 0.1 + light_e * 0.5 * static_cast<double>(band);
      EXPECT_LT(sigmas(m.mean - 200, mean, std::sqrt(mean / m.count)), 5) << light_e << ", band " << band;
      EXPECT_LT(sigmas(m.variance(), mean, m.variance_error()), 5) << light_e << ", band " << band;
    }
  }
}

TEST(Emccd, RefusesWhatItCannotRead) {
  const auto sensor = make_emccd(plain_emccd(), "A");
  CameraSettings settings = whole(*sensor);
  settings.region.width += 1;
  EXPECT_THROW(sensor->begin(settings, {}, 1, 0), Error);
  settings = whole(*sensor);
  settings.binning_x = 3;  // 160 is no multiple
  EXPECT_THROW(sensor->begin(settings, {}, 1, 0), Error);
  settings = whole(*sensor);
  settings.readout_mode = 2;
  EXPECT_THROW(sensor->begin(settings, {}, 1, 0), Error);
  settings = whole(*sensor);
  settings.em_gain = 0.9;
  EXPECT_THROW(sensor->begin(settings, {}, 1, 0), Error);
  EXPECT_THROW(sensor->begin(whole(*sensor), uniform_light(-1), 1, 0), Error);
  EXPECT_THROW(sensor->begin(whole(*sensor), uniform_light(std::nan("")), 1, 0), Error);
}

}  // namespace
}  // namespace atomcam
