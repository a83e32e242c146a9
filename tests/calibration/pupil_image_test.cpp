// The fit's image of a point against the simulation's own table.
#include "calibration/pupil_image.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace atomcam {
namespace {

OpticsDescription aberrated() {
  OpticsDescription optics;
  optics.magnification = 78.125;
  optics.zernike_um[3] = 0.05;
  optics.zernike_um[6] = -0.01;
  optics.zernike_um[7] = 0.015;
  optics.zernike_um[8] = 0.008;
  optics.zernike_um[10] = 0.02;
  optics.zernike_um[13] = -0.006;
  return optics;
}

TEST(PupilImage, AgreesWithTheTableOfTheSimulation) {
  const OpticsDescription optics = aberrated();
  const PupilImage image(optics, 10);
  const FineImage fine = image(optics.zernike_um, false);
  const PointSpreadFunction table(optics);
  for (const double shift : {0.0, 0.25, 0.5}) {  // positions on the fine grid
    PhotonImage expected({21, 21});
    table.add_expected(expected, 1, 10 + shift, 10);
    double largest = 0, brightest = 0, total = 0;
    for (int r = 0; r < 21; ++r)
      for (int c = 0; c < 21; ++c) {
        const int x = fine.centre + 4 * (c - 10) - static_cast<int>(4 * shift),
                  y = fine.centre + 4 * (r - 10);
        largest = std::max(largest, std::fabs(fine.share(y, x) - static_cast<double>(expected(r, c))));
        brightest = std::max(brightest, static_cast<double>(expected(r, c)));
        total += fine.share(y, x);
      }
    // Both describe the same integral; the table's cells are 1/40 of the diffraction unit.
    EXPECT_LT(largest, 0.004 * brightest) << shift;
    EXPECT_LT(total, 1);
    EXPECT_GT(total, 0.9);
  }
}

TEST(PupilImage, DerivativesAreThoseOfItsOwnImage) {
  const OpticsDescription optics = aberrated();
  const PupilImage image(optics, 8);
  const FineImage at = image(optics.zernike_um, true);
  const double step = 1e-5;
  for (int k = 0; k < fitted_zernikes; ++k) {
    auto up = optics.zernike_um, down = optics.zernike_um;
    up[k + first_fitted_zernike] += step;
    down[k + first_fitted_zernike] -= step;
    const Eigen::ArrayXXd difference = (image(up, false).share - image(down, false).share) / (2 * step);
    EXPECT_LT((difference - at.by_zernike[k]).abs().maxCoeff(), 1e-5 * difference.abs().maxCoeff() + 1e-7)
        << k;
  }
}

}  // namespace
}  // namespace atomcam
