#include <gtest/gtest.h>

#include "base/random.hpp"
#include "sensor/frames.hpp"

namespace atomcam {
namespace {

/// 64-bit FNV-1a over the counts.
std::uint64_t fingerprint(const CountImage& image) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const std::uint16_t count : image.pixels()) hash = (hash ^ count) * 0x100000001b3u;
  return hash;
}

// Frames have the same bits on every machine and from every compiler. When a change of the model moves these
// numbers on purpose, take the new ones and say so in the change log: old seeds then give other frames.

TEST(Golden, EmccdFrame) {
  EmccdDescription description;
  description.shape = {64, 80};
  description.readout_modes = {{Amplifier::electron_multiplying, ScanMode::standard, 17e6, "1x", 4.11, 89}};
  const auto sensor = make_emccd(description, "golden");
  SensorLight light = one_pixel(sensor->shape(), 30, 40, 500);
  light.background_e = 0.7;
  EXPECT_EQ(fingerprint(read(*sensor, whole(*sensor), light)), 15592792152785830525u);
}

TEST(Golden, QcmosFrame) {
  QcmosDescription description;
  description.shape = {64, 80};
  description.dark_rate_e_per_s = 5;
  description.offset_sigma_counts = 1;
  description.column_gumbel_counts = 0.5;
  description.row_offset_sigma_counts = 0.5;
  description.gain_sigma = 0.01;
  description.row_noise_e = 0.02;
  description.flicker_noise_e = 0.01;
  description.readout_modes = {{Amplifier::conventional, ScanMode::standard, 0, "", 0.107, 0.43}};
  const auto sensor = make_qcmos(description, "golden");
  EXPECT_EQ(fingerprint(read(*sensor, whole(*sensor), uniform_light(0.7))), 15493819409242152703u);
}

}  // namespace
}  // namespace atomcam
