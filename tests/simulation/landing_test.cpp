// Where light lands, and what of it comes while the frame is shifted.

#include "simulation/landing.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "support/statistics.hpp"

namespace atomcam {
namespace {

class LandingLight : public testing::Test {
 protected:
  LandingLight() : functions_(optics_, 0) {
    light_.emitters = &emitters_;
    landing_ = {.point_spread = &functions_,
                .light = &light_,
                .region = {0, 0, 40, 48},
                .window = {.exposure_s = 1, .light_end_s = 1},
                .electrons_per_photon = 1,
                .pixels_per_um = 1,
                .seed = 3};
  }

  PhotoElectrons draw(std::uint64_t frame) {
    landing_.frame = frame;
    std::vector<std::int64_t> detected(emitters_.size());
    PhotoElectrons electrons = landing_.draw(detected, 1);
    detected_ = std::accumulate(detected.begin(), detected.end(), std::int64_t{0});
    return electrons;
  }

  OpticsDescription optics_;
  PointSpreadFunctions functions_;
  std::vector<Emitter> emitters_{{.site = 0, .x_px = 20, .y_px = 12, .end_s = 1, .rate_hz = 400}};
  LightField light_;
  Landing landing_;
  std::int64_t detected_ = 0;
};

using Smear = LandingLight;
using Apodisation = LandingLight;

TEST_F(Apodisation, IsThePupilsOwn) {
  PhotonImage seen(landing_.plane()), own(landing_.plane());
  light_.pupil_edge_loss = 0.4;
  landing_.add_expected(seen);
  optics_.pupil_edge_loss = 0.4;
  PointSpreadFunction(optics_).add_expected(own, 400, 20, 12);
  for (std::size_t i = 0; i < own.pixels().size(); ++i) EXPECT_EQ(seen.pixels()[i], own.pixels()[i]);
  // What is beyond the first dark ring (4.2 pixels) is fainter.
  const PointSpreadFunction even(OpticsDescription{}), dimmed(optics_);
  EXPECT_LT(1 - dimmed.fraction_within(6), 0.8 * (1 - even.fraction_within(6)));
}

TEST_F(Smear, HasTheExpectedImage) {
  light_.smear_from_above = 0.01;
  light_.smear_from_below = 0.004;
  PhotonImage expected(landing_.plane()), mean(landing_.plane());
  landing_.add_expected(expected);
  constexpr int frames = 2000;
  for (std::uint64_t frame = 0; frame < frames; ++frame) {
    const PhotoElectrons electrons = draw(frame);
    for (int row = 0; row < mean.rows(); ++row)
      for (const std::uint16_t column : electrons.row(row)) mean(row, column) += 1.0f / frames;
  }
  double chi2 = 0, pixels = 0;
  for (std::size_t i = 0; i < mean.pixels().size(); ++i) {
    const double e = static_cast<double>(expected.pixels()[i]);
    if (e * frames < 20) continue;
    chi2 += std::pow(static_cast<double>(mean.pixels()[i]) - e, 2) * frames / e;
    pixels += 1;
  }
  EXPECT_GT(pixels, 100);
  EXPECT_NEAR(chi2, pixels, 5 * std::sqrt(2 * pixels));
}

// The electrons of the streak are others than those of the atom's image: all of a column scatter as a Poisson
// number does, and the atom's own count knows nothing of the streak.
TEST_F(Smear, HasShotNoiseOfItsOwn) {
  light_.smear_from_above = light_.smear_from_below = 0.02;
  std::vector<double> all;
  double own = 0;
  constexpr int frames = 20000;
  for (std::uint64_t frame = 0; frame < frames; ++frame) {
    all.push_back(static_cast<double>(draw(frame).columns.size()));
    own += static_cast<double>(detected_) / frames;
  }
  const statistics::Moments seen = statistics::moments(all);
  EXPECT_NEAR(seen.variance() / seen.mean, 1, 5 * std::sqrt(2.0 / frames));
  EXPECT_NEAR(seen.mean / own, 1 + 0.02 * 48, 5 * std::sqrt(2.0 / (own * frames)));
}

// Of a pixel's light the rows on one side only.
TEST_F(Smear, FallsToOneSide) {
  light_.smear_from_below = 1;
  const PhotoElectrons electrons = draw(0);
  EXPECT_GT(electrons.row(0).size(), 100);
  EXPECT_LT(electrons.row(40).size(), 20);
}

}  // namespace
}  // namespace atomcam
