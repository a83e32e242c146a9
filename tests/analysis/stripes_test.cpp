#include "analysis/stripes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace atomcam {
namespace {

/// Read noise of four counts, single electrons' tails, and stripes of a phase of their own in every frame.
FramesInMemory dark_frames(double amplitude, double period_px, double row_phase_deg) {
  constexpr int frames = 60;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0, 4);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::exponential_distribution<double> electron(1 / 60.0);
  std::vector<CountImage> list;
  for (int n = 0; n < frames; ++n) {
    CountImage frame(Shape{70, 96});
    const double phase = uniform(random);
    for (int r = 0; r < 70; ++r)
      for (int c = 0; c < 96; ++c) {
        const double turns = phase + c / period_px + r * row_phase_deg / 360;
        frame(r, c) = static_cast<std::uint16_t>(
            std::lround(200 + noise(random) + amplitude * std::sin(2 * std::numbers::pi * turns) +
                        (uniform(random) < 0.01 ? electron(random) : 0)));
      }
    list.push_back(std::move(frame));
  }
  return FramesInMemory(std::move(list));
}

TEST(Stripes, AreFoundWithTheirDirection) {
  for (const double period_px : {4.3, 24.0, 37.3})
    for (const double row_phase_deg : {-175.0, -82.5, 3.0, 60.0, 170.0}) {
      const auto found = strongest_stripes(dark_frames(0.6, period_px, row_phase_deg));
      ASSERT_TRUE(found) << period_px << " px, " << row_phase_deg << " deg";
      EXPECT_NEAR(1 / found->period_px, 1 / period_px, 0.3 / 96);
      EXPECT_NEAR(std::remainder(found->row_phase_deg - row_phase_deg, 360), 0, 0.3 * 360 / 70);
    }
}

TEST(Stripes, NoiseHasNone) {
  EXPECT_FALSE(strongest_stripes(dark_frames(0, 24, 60)));
}

}  // namespace
}  // namespace atomcam
