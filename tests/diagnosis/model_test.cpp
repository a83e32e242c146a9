#include "diagnosis/model.hpp"

#include <gtest/gtest.h>

namespace atomcam {
namespace {

TEST(Model, AnEstimateKnownWorseThanByItsDrawsIsNotLedBeyondThem) {
  std::vector<Uncertain> open(3);
  for (Uncertain& one : open) {
    one.centre = 1;
    one.width = 0.1;
  }
  const Standard::Estimate out =
      within_draws({Eigen::Vector3d(9, 9, 9), Eigen::Vector3d(0.5, 0.5, 0.1)}, open, 1);
  EXPECT_EQ(out.value(0), 9);  // calibration's: other knowledge
  EXPECT_NEAR(out.value(1), 1.2, 1e-12);
  EXPECT_EQ(out.value(2), 9);
  EXPECT_EQ(out.error(1), 0.5);
}

}  // namespace
}  // namespace atomcam
