#include "diagnosis/model.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "calibration/site_model.hpp"
#include "diagnosis/blind.hpp"

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
  model.open = effect_prior(*find_effect("frame_intensity_noise"), 64, 300);
  ASSERT_EQ(model.open[1].name, "effects.frame_intensity_noise.correlation");
  const double most = find_effect("frame_intensity_noise")->parameters[1].maximum;
  model.estimate.setConstant(std::ssize(model.open), 0.5);
  model.error.setConstant(std::ssize(model.open), 0.03);
  const auto beyond = [&](double correlation) {
    model.estimate(1) = correlation;
    return beyond_its_law(model);
  };
  EXPECT_EQ(beyond(0.5), "");
  EXPECT_EQ(beyond(most + 0.05), "");  // within the errors
  EXPECT_EQ(beyond(most + 0.15), model.open[1].name);
  EXPECT_EQ(beyond(-0.2), "");
  model.error(1) = 0.3;
  EXPECT_EQ(beyond(most + 0.15), "");
  // The strength may be whatever it is.
  model.error.setConstant(std::ssize(model.open), 0.03);
  model.estimate(0) = model.open[0].highest + 5;
  EXPECT_EQ(beyond(0.5), "");
}

// Where the catalogue's law ends another effect may begin, but not beyond all of something.
TEST(Model, AShareIsNeverBeyondItsLaw) {
  Model model;
  model.effects = {"vibration_jitter"};
  model.open = effect_prior(*find_effect("vibration_jitter"), 64, 300);
  model.estimate.setConstant(std::ssize(model.open), 0.5);
  model.error.setConstant(std::ssize(model.open), 0.01);
  ASSERT_EQ(model.open.back().name, "effects.vibration_jitter.slow_share");
  model.estimate(std::ssize(model.open) - 1) = 1.4;
  EXPECT_EQ(beyond_its_law(model), "");
}

TEST(Model, OpticalDetailIsTheSameForAllSites) {
  BlindOptions options;
  options.rows = options.columns = 48;
  StackPlan plan;
  plan.frames = 300;
  plan.model = stack_model(make_blind_stack(options, 0).lab);
  const auto declarations = battery(plan.model, false);
  const auto detail_of = [&](std::string_view name) {
    const auto one = std::find_if(declarations.begin(), declarations.end(),
                                  [&](const StatisticDeclaration& each) { return each.name == name; });
    EXPECT_NE(one, declarations.end()) << name;
    const auto count = std::ssize(declarations);
    return optical_detail(Eigen::VectorXd::Constant(count, 2), plan)(one - declarations.begin());
  };
  EXPECT_DOUBLE_EQ(detail_of("light.point_spread.ring.4"), 3);
  EXPECT_DOUBLE_EQ(detail_of("light.point_spread.width_x.mean"), 3);
  EXPECT_DOUBLE_EQ(detail_of("light.point_spread.width_x.spread"), 1);
  EXPECT_DOUBLE_EQ(detail_of("light.point_spread.x.smooth"), 1);
  EXPECT_DOUBLE_EQ(detail_of("light.static_charge.radial"), 3);  // what the wings bend
  EXPECT_DOUBLE_EQ(detail_of("light.static_charge.gradient_x"), 0);
  plan.frames = 1200;  // twice as well known, and the images no better
  EXPECT_DOUBLE_EQ(detail_of("light.point_spread.ring.4"), 6);
}

TEST(Model, WhatItsStacksDoNotVaryIsUncertainAllTheSame) {
  // Two statistics; the first follows the shared parameter by 3 per unit, the second nothing.
  constexpr int stacks = 60;
  Model plain, model;
  plain.population.draws.resize(stacks, 2);
  plain.population.whole.resize(stacks, 2);
  RandomStream random(7, stream_id("test"), 0, 0);
  const auto noise = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32 - 0.5; };
  for (int n = 0; n < stacks; ++n) {
    for (int k = 0; k < 2; ++k) plain.population.draws(n, k) = noise();
    plain.population.whole(n, 0) = 3 * plain.population.draws(n, 0) + 0.1 * noise();
    plain.population.whole(n, 1) = noise();
  }
  plain.standard = std::make_unique<Standard>(plain.population, Part::whole);
  plain.open.resize(2);
  plain.open[0].width = 0.2;
  plain.open[0].shared = true;
  plain.open[1].width = 0.5;
  plain.first_effect_parameter = 2;
  model.open = plain.open;
  model.first_effect_parameter = 2;
  leave_undrawn(model, plain);
  EXPECT_EQ(model.open[0].width, 0);
  EXPECT_EQ(model.open[1].width, 0.5);
  EXPECT_NEAR(model.undrawn(0), 0.6, 0.06);
  EXPECT_EQ(model.undrawn(1), 0);
}

// Stacks of optics with hardly any aberration calibrate to either sign of the even terms; the one that they
// were simulated with must not be taken for the other.
TEST(Model, RecalibratingComesBackFromTheOtherSideOfAPerfectFocus) {
  BlindOptions options;
  options.rows = options.columns = 48;
  options.none_share = 1;
  BlindStack blind = make_blind_stack(options, 2);
  blind.lab.optics.zernike_um = {};
  blind.lab.optics.zernike_um[10] = 0.02;
  StackPlan plan;
  plan.frames = 60;
  plan.dark_frames = 30;
  plan.threads = 2;
  const auto light = simulate_stack(blind.lab, plan, 1, true),
             darks = simulate_stack(blind.lab, plan, 1, false);
  CalibrationInput input;
  const Notes notes = parse_notes(blind.notes, "notes");
  input.notes = notes;
  input.frames = light.get();
  input.darks = darks.get();
  const Calibration calibration = calibrate(input);
  plan.model = calibration.model;
  const RealStack real{nullptr, &calibration, &notes};
  Model model;
  model.lab = calibration.lab;
  model.open = calibration_uncertainty(calibration);
  model.first_effect_parameter = std::ssize(model.open);
  const auto spherical = std::find_if(model.open.begin(), model.open.end(),
                                      [](const Uncertain& one) { return one.name == "zernike_spherical"; });
  ASSERT_NE(spherical, model.open.end());
  const double there = calibration.optics.zernike_um[10], other_side = -1.5 * there - spherical->centre;
  ASSERT_GT(std::fabs(other_side), 5 * spherical->width);
  spherical->centre = other_side;
  for (std::uint64_t round = 0; round < 3; ++round)
    recalibrate(model, real, plan, numbers_of("recalibration") + round * 100);
  EXPECT_LT(std::fabs(spherical->centre), 0.3 * std::fabs(other_side));
}

}  // namespace
}  // namespace atomcam
