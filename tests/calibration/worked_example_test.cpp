// The paper's worked example ("Fitting Parameter Values") step by step, with the figures that it prints.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "optics/optics.hpp"

namespace atomcam {
namespace {

OpticsDescription paper_optics() {
  OpticsDescription optics;
  optics.wavelength_um = 0.461;
  optics.numerical_aperture = 0.65;
  optics.magnification = 156.25;
  optics.pixel_um = 16;  // binned 2 x 2 in the paper's frames
  optics.zernike_um = {0,           0,           0,           0.07232454,  0.00087644,
                       -0.01069755, 0.00280808,  0.00723265,  0.00436401,  0.00117688,
                       0.02449155,  -0.00427388, -0.00250116, -0.00477205, -0.00054310};
  return optics;
}

/// Light of a site within 3 binned pixels, by pixels whose centres are that near, as sums over a mask take
/// it.
double in_mask(const OpticsDescription& optics, double reach_px) {
  const PointSpreadFunction table(optics);
  PhotonImage image({41, 41});
  table.add_expected(image, 1, 40.5, 40.5, 0, 0, 2, 2);  // the middle of a binned pixel
  double sum = 0;
  for (int r = 0; r < 41; ++r)
    for (int c = 0; c < 41; ++c)
      if (std::hypot(r - 20, c - 20) <= reach_px) sum += static_cast<double>(image(r, c));
  return sum;
}

TEST(WorkedExample, OfThePaper) {
  const double distance = 1.08e4, electrons_per_count = 4.85, em_gain = 300, efficiency = 0.86,
               exposure = 0.08;
  const double photons = distance * electrons_per_count / em_gain / efficiency;
  const double collected = collected_fraction(0.65), emitted = photons / collected, rate = emitted / exposure;
  std::printf("photons in the region of interest   %8.1f   (paper 2.02e2: +%.2f %%)\n", photons,
              100 * (photons / 202 - 1));
  std::printf("collected fraction                  %8.4f   (paper 0.120)\n", collected);
  std::printf("photons per atom and exposure       %8.0f   (paper 1.69e3)\n", emitted);
  std::printf("photons per atom and second         %8.0f   (paper 2.11e4)\n", rate);
  std::printf("  over 83.8 %% of an Airy disc       %8.0f   (paper 2.52e4)\n", rate / 0.838);
  std::printf("  over the paper's 62.3 %%           %8.0f   (paper 3.39e4)\n", rate / 0.623);
  EXPECT_NEAR(photons, 2.02e2, 0.01 * 2.02e2);
  EXPECT_NEAR(collected, 0.120, 0.0005);
  EXPECT_NEAR(emitted, 1.69e3, 0.01 * 1.69e3);
  EXPECT_NEAR(rate, 2.11e4, 0.01 * 2.11e4);
  EXPECT_NEAR(rate / 0.838, 2.52e4, 0.01 * 2.52e4);
  EXPECT_NEAR(rate / 0.623, 3.39e4, 0.01 * 3.39e4);
  const OpticsDescription optics = paper_optics();
  const double circle = PointSpreadFunction(optics).fraction_within(6), mask = in_mask(optics, 3),
               wide = in_mask(optics, 3.5);
  std::printf(
      "light within a circle of 3 binned pixels %.4f, in pixels up to 3.0 away %.4f, up to 3.5 away %.4f "
      "(paper 0.623)\n",
      circle, mask, wide);
  OpticsDescription ideal = optics;
  ideal.zernike_um = {};
  std::printf("  of an ideal lens: %.4f, %.4f, %.4f\n", PointSpreadFunction(ideal).fraction_within(6),
              in_mask(ideal, 3), in_mask(ideal, 3.5));
  std::printf("rate with our fraction in the mask  %8.0f\n", rate / mask);
  // Aberrations send light out; the paper's figure lies between the ways to count it.
  EXPECT_LT(circle, PointSpreadFunction(ideal).fraction_within(6));
  const double tail = 73.2 * 4.11;
  std::printf("tail: 73.2 counts x 4.11 e/count = %.1f (paper 301, set 300)\n", tail);
  EXPECT_NEAR(tail, 301, 0.5);
  const double survival = 0.243 / (0.243 + 0.364);
  std::printf("survival 0.243 / (0.243 + 0.364) = %.4f (paper 0.400)\n", survival);
  EXPECT_NEAR(survival, 0.400, 0.0005);
  std::printf("spurious charge: 2.62 per binned pixel = %.3f per pixel; x 4.85 = %.3f (paper 0.655, 3.18)\n",
              2.62 / 4, 2.62 / 4 * 4.85);
  EXPECT_NEAR(2.62 / 4 * 4.85, 3.18, 0.005);
}

}  // namespace
}  // namespace atomcam
