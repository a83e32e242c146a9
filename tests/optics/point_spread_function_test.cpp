#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "base/error.hpp"
#include "optics/optics.hpp"

namespace atomcam {
namespace {

double sum(const PhotonImage& image) {
  return std::accumulate(image.pixels().begin(), image.pixels().end(), 0.0);
}

TEST(PointSpreadFunction, KeepsAllLight) {
  const PointSpreadFunction psf{OpticsDescription{}};
  const int reach = static_cast<int>(psf.reach_px()) + 2;
  PhotonImage image(Shape{2 * reach + 1, 2 * reach + 1});
  psf.add_expected(image, 1, reach + 0.3, reach - 0.4);
  EXPECT_NEAR(sum(image), 1, 1e-6);  // single precision pixels
  EXPECT_NEAR(psf.fraction_within(2 * psf.reach_px()), 1, 1e-12);
}

TEST(PointSpreadFunction, RefusesBadOptics) {
  OpticsDescription optics;
  optics.numerical_aperture = 1;
  EXPECT_THROW(PointSpreadFunction{optics}, Error);
  optics = {};
  optics.zernike_um[3] = std::nan("");
  EXPECT_THROW(PointSpreadFunction{optics}, Error);
  optics = {};
  optics.zernike_um[3] = 1000;
  EXPECT_THROW(PointSpreadFunction{optics}, Error);
}

}  // namespace
}  // namespace atomcam
