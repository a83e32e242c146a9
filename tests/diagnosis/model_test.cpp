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

TEST(Model, AnEffectIsNotWhatItsLawDoesNotReach) {
  Model model;
  model.effects = {"frame_intensity_noise"};
  model.open = effect_prior(*find_effect("frame_intensity_noise"), 64);
  ASSERT_EQ(model.open[1].name, "effects.frame_intensity_noise.correlation");
  const double most = find_effect("frame_intensity_noise")->parameters[1].maximum;
  model.estimate.setConstant(std::ssize(model.open), 0.5);
  model.error.setConstant(std::ssize(model.open), 0.03);
  const auto beyond = [&](double correlation) {
    model.estimate(1) = correlation;
    return beyond_its_law(model);
  };
  EXPECT_FALSE(beyond(0.5));
  EXPECT_FALSE(beyond(most + 0.05));  // within the errors
  EXPECT_TRUE(beyond(most + 0.15));
  EXPECT_FALSE(beyond(-0.2));
  model.error(1) = 0.3;
  EXPECT_FALSE(beyond(most + 0.15));
  // The strength may be whatever it is.
  model.error.setConstant(std::ssize(model.open), 0.03);
  model.estimate(0) = model.open[0].highest + 5;
  EXPECT_FALSE(beyond(0.5));
}

}  // namespace
}  // namespace atomcam
