#include "sensor/qcmos.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <thread>

#include "base/error.hpp"
#include "base/random.hpp"
#include "sensor/defects.hpp"
#include "sensor/frames.hpp"
#include "support/instruction_sets.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::correlation;
using statistics::kolmogorov_p;
using statistics::level;
using statistics::moments;
using statistics::sigmas;

constexpr double e_per_count = 0.107;

QcmosDescription plain_qcmos(double read_noise_e = 0.43) {
  QcmosDescription description;
  description.shape = {120, 200};
  description.dark_rate_e_per_s = 0;
  description.read_noise_log_sigma = 0;
  description.readout_modes = {
      {Amplifier::conventional, ScanMode::standard, 0, "", e_per_count, read_noise_e},
      {Amplifier::conventional, ScanMode::ultra_quiet, 0, "", e_per_count, read_noise_e * 0.6}};
  return description;
}

QcmosDescription real_qcmos() {
  QcmosDescription description = plain_qcmos();
  description.dark_rate_e_per_s = 0.5;
  description.offset_sigma_counts = 2;
  description.column_gumbel_counts = 1;
  description.row_offset_sigma_counts = 1;
  description.gain_sigma = 0.01;
  description.read_noise_log_sigma = 0.3;
  description.row_noise_e = 0.05;
  description.flicker_noise_e = 0.02;
  return description;
}

CameraSettings at_reference(const Sensor& sensor) {
  CameraSettings settings = whole(sensor);
  settings.sensor_temperature_c = -35;
  return settings;
}

/// Mean of every pixel over frames.
std::vector<double> pixel_means(const Sensor& sensor, const CameraSettings& settings, std::uint64_t first,
                                std::uint64_t frames) {
  std::vector<double> means(sensor.shape().pixels(), 0.0);
  for (std::uint64_t frame = first; frame < first + frames; ++frame) {
    const CountImage image = read(sensor, settings, {}, frame);
    for (std::size_t i = 0; i < means.size(); ++i)
      means[i] += image.pixels()[i] / static_cast<double>(frames);
  }
  return means;
}

TEST(Qcmos, MeanIsLinearInTheLightWithAllNoiseOn) {
  // A known defect of a predecessor: row and flicker noise added to whole electrons, which cost one electron
  // per lit pixel. Every noise on, maps without spread: the mean is bias + light / (e-/count) from 0.05 to 30
  // electrons.
  QcmosDescription description = plain_qcmos();
  description.row_noise_e = 0.05;
  description.flicker_noise_e = 0.05;
  const auto sensor = make_qcmos(description, "A");
  for (const double light_e : {0.0, 0.05, 0.2, 1.0, 3.0, 10.0, 30.0}) {
    std::vector<double> frame_means;  // row noise is common to a row: independent values are frames
    for (std::uint64_t frame = 0; frame < 40; ++frame)
      frame_means.push_back(
          moments(read(*sensor, at_reference(*sensor), uniform_light(light_e), frame).pixels()).mean);
    const auto m = moments(frame_means);
    EXPECT_LT(sigmas(m.mean, 200 + light_e / e_per_count, std::sqrt(m.variance() / 39)), 5) << light_e;
  }
}

TEST(Qcmos, DarkPixelsHaveTheModesReadNoise) {
  for (const double spread : {0.0, 0.4}) {
    QcmosDescription description = plain_qcmos();
    description.read_noise_log_sigma = spread;
    const auto sensor = make_qcmos(description, "A");
    // The rms over pixels is the mode's value; of this serial number's pixels, what its map says.
    const QcmosMaps maps = draw_qcmos_maps(description, "A");
    std::vector<double> squares;
    for (const float ratio : maps.read_noise_ratio->pixels()) squares.push_back(std::pow(ratio, 2));
    const auto population = moments(squares);
    EXPECT_LE(std::fabs(population.mean - 1), 5 * population.mean_error() + 1e-6);
    for (const int mode : {0, 1}) {
      CameraSettings settings = at_reference(*sensor);
      settings.readout_mode = mode;
      const auto m = moments(read(*sensor, settings, {}).pixels());
      const double noise_e = mode == 0 ? 0.43 : 0.258;
      EXPECT_LT(sigmas(m.variance(), std::pow(noise_e / e_per_count, 2) * population.mean + 1.0 / 12,
                       m.variance_error()),
                5)
          << mode << ", " << spread;
      EXPECT_LT(sigmas(m.mean, 200, m.mean_error()), 5);
    }
  }
}

TEST(Qcmos, FixedPatternPersistsFromFrameToFrame) {
  // A known defect of a predecessor: the maps were drawn again for every image. Two halves of a series agree.
  const auto sensor = make_qcmos(real_qcmos(), "A");
  const auto a = pixel_means(*sensor, at_reference(*sensor), 0, 60);
  const auto b = pixel_means(*sensor, at_reference(*sensor), 60, 60);
  EXPECT_GT(correlation(a, b), 0.9);
  const auto other = make_qcmos(real_qcmos(), "B");
  const auto c = pixel_means(*other, at_reference(*other), 0, 60);
  EXPECT_LT(correlation(a, c), 0.5);  // rows and columns share what is left
}

TEST(Qcmos, SerialNumberIsTheSensor) {
  const QcmosMaps a = draw_qcmos_maps(real_qcmos(), "A"), again = draw_qcmos_maps(real_qcmos(), "A");
  const QcmosMaps b = draw_qcmos_maps(real_qcmos(), "B");
  EXPECT_EQ(*a.offset_counts, *again.offset_counts);
  EXPECT_EQ(*a.dark_ratio, *again.dark_ratio);
  EXPECT_NE(*a.offset_counts, *b.offset_counts);
  EXPECT_NE(*a.gain_ratio, *b.gain_ratio);
  EXPECT_NE(*a.read_noise_ratio, *b.read_noise_ratio);
  EXPECT_NE(*a.dark_ratio, *b.dark_ratio);
}

TEST(Qcmos, MapsFollowTheirLaws) {
  QcmosDescription description = plain_qcmos();
  description.offset_sigma_counts = 2;
  description.gain_sigma = 0.01;
  description.read_noise_log_sigma = 0.3;
  const auto normal = [](double z) { return 0.5 * std::erfc(-z / std::sqrt(2.0)); };
  const auto values = [](std::span<const float> pixels) {
    return std::vector<double>(pixels.begin(), pixels.end());
  };
  QcmosMaps maps = draw_qcmos_maps(description, "A");
  EXPECT_GT(kolmogorov_p(values(maps.offset_counts->pixels()), [&](double x) { return normal(x / 2); }),
            level);
  EXPECT_GT(kolmogorov_p(values(maps.gain_ratio->pixels()), [&](double x) { return normal((x - 1) / 0.01); }),
            level);
  EXPECT_GT(kolmogorov_p(values(maps.read_noise_ratio->pixels()),
                         [&](double x) { return normal((std::log(x) + 0.09) / 0.3); }),
            level);
  for (const double shape : {0.4, 1.0, 5.0}) {
    description.dark_gamma_shape = shape;
    maps = draw_qcmos_maps(description, "A");
    EXPECT_GT(kolmogorov_p(values(maps.dark_ratio->pixels()),
                           [&](double x) { return boost::math::gamma_p(shape, x * shape); }),
              level)
        << shape;
  }
  // Columns: Gumbel of mean zero; rows: normal.
  description.offset_sigma_counts = 0;
  description.shape = {4, 20000};
  description.column_gumbel_counts = 1.5;
  maps = draw_qcmos_maps(description, "A");
  std::vector<double> columns;
  for (int c = 0; c < 20000; ++c) {
    columns.push_back((*maps.offset_counts)(0, c));
    ASSERT_EQ((*maps.offset_counts)(0, c), (*maps.offset_counts)(3, c));
  }
  EXPECT_GT(
      kolmogorov_p(columns, [](double x) { return std::exp(-std::exp(-x / 1.5 - 0.57721566490153286)); }),
      level);
  description.shape = {20000, 4};
  description.column_gumbel_counts = 0;
  description.row_offset_sigma_counts = 0.7;
  maps = draw_qcmos_maps(description, "A");
  std::vector<double> rows;
  for (int r = 0; r < 20000; ++r) rows.push_back((*maps.offset_counts)(r, 2));
  EXPECT_GT(kolmogorov_p(rows, [&](double x) { return normal(x / 0.7); }), level);
}

TEST(Qcmos, MapsFromCalibrationReplaceDrawnOnes) {
  const QcmosDescription description = plain_qcmos(0);
  auto offset = std::make_shared<Image<float, unit::counts>>(description.shape);
  auto gain = std::make_shared<RatioMap>(description.shape, 1.0f);
  auto dark = std::make_shared<RatioMap>(description.shape, 0.0f);
  (*offset)(7, 9) = 31;
  (*gain)(8, 10) = 1.5;
  (*dark)(9, 11) = 24000;
  QcmosDescription warm = description;
  warm.dark_rate_e_per_s = 1;
  const auto sensor = make_qcmos(warm, "A", {offset, gain, nullptr, dark});
  CameraSettings settings = at_reference(*sensor);
  settings.exposure_s = 0.01;
  const SensorLight light = one_pixel(sensor->shape(), 8, 10, 100);
  const CountImage image = read(*sensor, settings, light);
  EXPECT_EQ(image(7, 9), 231);
  EXPECT_EQ(image(8, 10), 200 + 1402);  // 150 / 0.107
  EXPECT_EQ(image(0, 0), 200);
  EXPECT_LT(sigmas((image(9, 11) - 200) * e_per_count, 240, std::sqrt(240.0)), 5);
  EXPECT_THROW(
      make_qcmos(description, "A", {std::make_shared<Image<float, unit::counts>>(Shape{2, 2}), {}, {}, {}}),
      Error);
}

TEST(Qcmos, RefusesMapsWithoutNumbers) {
  const QcmosDescription description = plain_qcmos();
  for (const float value : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()})
    EXPECT_THROW(
        make_qcmos(description, "A",
                   {nullptr, std::make_shared<RatioMap>(description.shape, value), nullptr, nullptr}),
        Error);
}

TEST(Qcmos, DarkCurrentHasEveryPixelsOwnRateInBothMethods) {
  QcmosDescription description = plain_qcmos(0);
  description.dark_rate_e_per_s = 1;
  const auto sensor = make_qcmos(description, "A");
  const QcmosMaps maps = draw_qcmos_maps(description, "A");
  for (const double exposure_s : {0.02, 0.9, 4.0}) {  // few per row, many per row, one by one
    CameraSettings settings = at_reference(*sensor);
    settings.exposure_s = exposure_s;
    settings.region = {37, 11, 130, 90};  // ends within blocks
    std::vector<double> sums(static_cast<std::size_t>(130 * 90), 0.0);
    constexpr int frames = 60;
    for (std::uint64_t frame = 0; frame < frames; ++frame) {
      const CountImage image = read(*sensor, settings, {}, frame);
      for (std::size_t i = 0; i < sums.size(); ++i)
        sums[i] += std::nearbyint((image.pixels()[i] - 200) * e_per_count);
    }
    double chi = 0, low = 0, low_sum = 0;
    int cells = 0;
    for (int r = 0; r < 90; ++r) {
      for (int c = 0; c < 130; ++c) {
        const double expected = frames * exposure_s * (*maps.dark_ratio)(r + 11, c + 37);
        const double seen = sums[static_cast<std::size_t>(r * 130 + c)];
        low += expected;
        low_sum += seen;
        if (low < 20) continue;
        chi += (low_sum - low) * (low_sum - low) / low;
        low = low_sum = 0;
        ++cells;
      }
    }
    EXPECT_GT(boost::math::gamma_q(cells / 2.0, chi / 2), level) << exposure_s;
  }
}

TEST(Qcmos, DarkCurrentDoublesWithTheTemperature) {
  QcmosDescription description = plain_qcmos();
  description.dark_rate_e_per_s = 1;
  const auto sensor = make_qcmos(description, "A");
  const auto dark_e = [&](double temperature_c) {
    CameraSettings settings = at_reference(*sensor);
    settings.sensor_temperature_c = temperature_c;
    settings.exposure_s = 10;
    return moments(read(*sensor, settings, {}).pixels());
  };
  const auto cold = dark_e(-35), warm = dark_e(-22);
  const double error = 5 * (4 * cold.mean_error() + warm.mean_error());
  EXPECT_LT(std::fabs((warm.mean - 200) - 4 * (cold.mean - 200)), error);
}

TEST(Qcmos, RowNoiseIsCommonToARowAndNewInEveryFrame) {
  QcmosDescription description = plain_qcmos(0.1);
  description.row_noise_e = 1;
  const auto sensor = make_qcmos(description, "A");
  std::vector<double> row_means;
  for (std::uint64_t frame = 0; frame < 30; ++frame) {
    const CountImage image = read(*sensor, at_reference(*sensor), {}, frame);
    for (int r = 0; r < image.rows(); ++r) row_means.push_back(moments(image.row(r)).mean);
  }
  const auto m = moments(row_means);
  const double expected = (1 + 0.01 / 200) / (e_per_count * e_per_count);
  EXPECT_LT(sigmas(m.variance(), expected, m.variance_error() + 1.0 / 12 / 200), 5);
  EXPECT_LT(sigmas(m.mean, 200, m.mean_error()), 5);
}

TEST(Qcmos, FlickerNoiseIsASkewGumbelOfMeanZero) {
  QcmosDescription description = plain_qcmos(0);
  description.flicker_noise_e = 1;
  const auto sensor = make_qcmos(description, "A");
  const auto m = moments(read(*sensor, at_reference(*sensor), {}).pixels());
  const double variance = std::pow(3.14159265358979 / e_per_count, 2) / 6 + 1.0 / 12;
  EXPECT_LT(sigmas(m.mean, 200, m.mean_error()), 5);
  EXPECT_LT(sigmas(m.variance(), variance, m.variance_error()), 5);
  EXPECT_GT(m.m3 / std::pow(m.m2, 1.5), 1);  // 1.14 for a Gumbel law
}

TEST(Qcmos, FusedRowsGiveTheBitsOfTheSteps) {
  const auto sensor = make_qcmos(real_qcmos(), "A");
  for (const bool resolving : {false, true}) {
    CameraSettings settings = at_reference(*sensor);
    settings.photon_number_resolving = resolving;
    settings.region = {4, 8, 193, 100};
    settings.defect_correction = true;
    settings.hot_pixel_correction = HotPixelCorrection::aggressive;
    SensorLight light = one_pixel({100, 193}, 50, 192, 300);
    light.background_e = 0.4;
    EXPECT_EQ(read(*sensor, settings, light, 5), read_in_steps(*sensor, settings, light, 5));
  }
}

TEST(Qcmos, SameBitsOnEveryInstructionSet) {
  std::vector<CountImage> images;
  on_every_instruction_set([&](const char*) {
    const auto sensor = make_qcmos(real_qcmos(), "A");
    CameraSettings settings = at_reference(*sensor);
    settings.region = {3, 2, 187, 100};
    images.push_back(read(*sensor, settings, uniform_light(0.3)));
    settings.photon_number_resolving = true;
    images.push_back(read(*sensor, settings, uniform_light(3)));
  });
  for (std::size_t i = 2; i < images.size(); ++i) EXPECT_EQ(images[i], images[i % 2]);
}

TEST(Qcmos, SameBitsFromSeveralThreads) {
  const auto sensor = make_qcmos(real_qcmos(), "A");
  const CameraSettings settings = at_reference(*sensor);
  const SensorLight light = uniform_light(0.4);
  const CountImage expected = read(*sensor, settings, light);
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

TEST(Qcmos, RegionIsAWindowOnTheSamePixels) {
  const auto sensor = make_qcmos(real_qcmos(), "A");
  CameraSettings settings = at_reference(*sensor);
  const auto full = pixel_means(*sensor, settings, 0, 30);
  settings.region = {40, 20, 100, 60};
  std::vector<double> window(6000, 0.0), cut;
  for (std::uint64_t frame = 100; frame < 130; ++frame) {
    const CountImage image = read(*sensor, settings, {}, frame);
    for (std::size_t i = 0; i < window.size(); ++i) window[i] += image.pixels()[i];
  }
  for (std::size_t r = 20; r < 80; ++r)
    for (std::size_t c = 40; c < 140; ++c) cut.push_back(full[r * 200 + c]);
  EXPECT_GT(correlation(window, cut), 0.9);
}

TEST(Qcmos, BinsDigitallyAfterConversion) {
  const auto sensor = make_qcmos(plain_qcmos(), "A");
  CameraSettings settings = at_reference(*sensor);
  const CountImage single = read(*sensor, settings, uniform_light(2));
  settings.binning_x = 4;
  settings.binning_y = 2;
  const CountImage binned = read(*sensor, settings, uniform_light(2));
  ASSERT_EQ(binned.shape(), (Shape{60, 50}));
  for (int r = 0; r < binned.rows(); ++r) {
    for (int c = 0; c < binned.columns(); ++c) {
      int sum = 0;
      for (int y = 0; y < 2; ++y)
        for (int x = 0; x < 4; ++x) sum += single(2 * r + y, 4 * c + x);
      ASSERT_EQ(binned(r, c), sum);
    }
  }
  const auto m = moments(binned.pixels());  // eight pixels' noise, unlike binning on a chip
  const double variance = 8 * ((2 + 0.43 * 0.43) / (e_per_count * e_per_count) + 1.0 / 12);
  EXPECT_LT(sigmas(m.variance(), variance, m.variance_error()), 5);
  EXPECT_EQ(bin_digitally(CountImage({2, 2}, 40000), 2, 2)(0, 0), 65535);
}

TEST(Qcmos, WellAndConverterSaturate) {
  QcmosDescription description = plain_qcmos(0);
  auto sensor = make_qcmos(description, "A");
  const CountImage saturated1 = read(*sensor, at_reference(*sensor), uniform_light(1e5));
  for (const std::uint16_t count : saturated1.pixels())
    ASSERT_EQ(count, 65535);  // 7000 / 0.107 + 200 is beyond 16 bits
  description.full_well_e = 1000;
  sensor = make_qcmos(description, "A");
  const CountImage saturated2 = read(*sensor, at_reference(*sensor), uniform_light(1e5));
  for (const std::uint16_t count : saturated2.pixels()) ASSERT_EQ(count, 200 + 9346);  // 1000 / 0.107
}

TEST(Qcmos, PhotonNumberResolvingOutputIsWholeElectrons) {
  QcmosDescription description = real_qcmos();
  description.dark_rate_e_per_s = 0;
  description.row_noise_e = description.flicker_noise_e = 0;
  description.read_noise_log_sigma = 0;
  description.readout_modes = {{Amplifier::conventional, ScanMode::ultra_quiet, 0, "", e_per_count, 0.05}};
  const auto sensor = make_qcmos(description, "A");
  CameraSettings settings = at_reference(*sensor);
  settings.photon_number_resolving = true;
  // Noise so low that no count is ever mistaken: offsets and gains are calibrated out and the light's law
  // remains.
  const SensorLight light = uniform_light(1.5);
  const auto readout = sensor->begin(settings, light, 11, 0);
  const CountImage image = read(*sensor, settings, light);
  std::vector<std::int32_t> electrons(200);
  for (int r = 0; r < image.rows(); ++r) {
    readout->collect(r, electrons);
    for (int c = 0; c < image.columns(); ++c) ASSERT_EQ(image(r, c), electrons[static_cast<std::size_t>(c)]);
  }
  // With the real noise, false ones come as often as half an electron of noise does.
  description.readout_modes[0].read_noise_e = 0.27;
  const auto noisy = make_qcmos(description, "A");
  const CountImage dark = read(*noisy, settings, {});
  const double ones = static_cast<double>(std::count(dark.pixels().begin(), dark.pixels().end(), 1));
  const double n = static_cast<double>(dark.pixels().size());
  const double p =
      0.5 * std::erfc(0.5 / std::sqrt(0.27 * 0.27 + std::pow(e_per_count, 2) / 12) / std::sqrt(2.0));
  EXPECT_LT(sigmas(ones, n * p, std::sqrt(n * p)), 5);
}

TEST(Qcmos, DefectCorrectionReplacesOutliersByTheirNeighboursMedian) {
  const QcmosDescription description = plain_qcmos(0);
  auto noise = std::make_shared<RatioMap>(description.shape, 1.0f);
  auto dark = std::make_shared<RatioMap>(description.shape, 1.0f);
  (*noise)(50, 60) = 3.5;  // beyond the standard level, within the minimum
  (*noise)(50, 61) = 5;    // its neighbour, beyond all
  (*dark)(0, 0) = 20;      // a corner
  (*dark)(70, 80) = 8;     // beyond the aggressive level only
  auto offset = std::make_shared<Image<float, unit::counts>>(description.shape);
  for (const auto& [r, c] : {std::pair{50, 60}, {50, 61}, {0, 0}, {70, 80}}) (*offset)(r, c) = 1000;
  const auto sensor = make_qcmos(description, "A", {offset, nullptr, noise, dark});
  CameraSettings settings = at_reference(*sensor);
  const auto hot = [&](std::initializer_list<std::pair<int, int>> expected) {
    const CountImage image = read(*sensor, settings, {});
    std::size_t count = 0;
    for (const std::uint16_t value : image.pixels()) count += value != 200;
    EXPECT_EQ(count, expected.size());
    for (const auto& [r, c] : expected) EXPECT_EQ(image(r, c), 1200);
  };
  hot({{50, 60}, {50, 61}, {0, 0}, {70, 80}});
  settings.defect_correction = true;
  settings.hot_pixel_correction = HotPixelCorrection::minimum;
  hot({{50, 60}, {70, 80}});
  settings.hot_pixel_correction = HotPixelCorrection::standard;
  hot({{70, 80}});
  settings.hot_pixel_correction = HotPixelCorrection::aggressive;
  hot({});
  settings.region = {60, 50, 20, 20};  // a defect at the corner of a region
  EXPECT_EQ(read(*sensor, settings, {})(0, 0), 200);
}

TEST(Defects, MedianOfAnEvenNumberOfNeighboursIsTheirMiddle) {
  CountImage image({1, 3});
  image(0, 0) = 10;
  image(0, 1) = 999;
  image(0, 2) = 20;
  correct_defects({{5, 8}}, {7, 5, 3, 1}, image);
  EXPECT_EQ(image(0, 1), 15);
  EXPECT_EQ(image(0, 0), 10);
}

}  // namespace
}  // namespace atomcam
