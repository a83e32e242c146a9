// What calibration leaves open, and how far.
#include "diagnosis/uncertain.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "diagnosis/population.hpp"

namespace atomcam {
namespace {

double width_of(const std::vector<Uncertain>& open, std::string_view name) {
  const auto found =
      std::find_if(open.begin(), open.end(), [&](const Uncertain& one) { return one.name == name; });
  return found == open.end() ? 0 : found->width;
}

TEST(Uncertain, FewDarkFramesLeaveAQcmosNoiseMoreOpen) {
  Calibration calibration;
  calibration.lab = preset("orca-quest");
  calibration.dark_maps.read_noise_counts = 4;
  calibration.dark_maps.read_noise_log_sigma.square = 0.3 * 0.3;
  calibration.dark_maps.read_noise_error = 0.004;  // hundreds of frames
  const auto many = calibration_uncertainty(calibration);
  calibration.dark_maps.read_noise_error = 0.08;
  calibration.dark_maps.read_noise_log_sigma.error_of_square = 2 * 0.3 * 0.1;
  const auto few = calibration_uncertainty(calibration);
  EXPECT_DOUBLE_EQ(width_of(many, "read_noise"), 0.006);
  EXPECT_DOUBLE_EQ(width_of(few, "read_noise"), 1.5 * 0.08 / 4);
  EXPECT_GT(width_of(few, "read_noise_spread"), 2 * width_of(many, "read_noise_spread"));
}

// Chance leaves nothing of a small spread now and then; taken for none at all, it made a gap of every such
// stack.
TEST(Uncertain, ASpreadThatWasEstimatedAsNoneIsAsOpenAsAnyOther) {
  Calibration calibration;
  calibration.lab = preset("orca-quest");
  calibration.dark_maps.read_noise_counts = 4;
  std::get<QcmosDescription>(calibration.lab.sensor).read_noise_log_sigma = 0;
  calibration.dark_maps.read_noise_log_sigma = {-0.001, 0.002};
  const auto open = calibration_uncertainty(calibration);
  const auto spread = std::find_if(open.begin(), open.end(),
                                   [](const Uncertain& one) { return one.name == "read_noise_spread"; });
  ASSERT_NE(spread, open.end());
  const auto applied = [&](double coordinate) {
    Lab lab = calibration.lab;
    spread->apply(lab, coordinate);
    return std::get<QcmosDescription>(lab.sensor).read_noise_log_sigma;
  };
  EXPECT_NEAR(applied(spread->width), std::sqrt(1.5 * 0.002), 1e-9);
  EXPECT_EQ(applied(-spread->width), 0);
  EXPECT_NEAR(spread->value(spread->width), std::sqrt(1.5 * 0.002), 1e-9);
  Calibration other = calibration;
  other.dark_maps.read_noise_log_sigma.square = 0.003;
  EXPECT_NEAR(spread->offset(calibration, other), -0.004, 1e-12);
}

TEST(Uncertain, AQcmosDarkCurrentIsOpenAndHowUnevenlyPixelsHaveIt) {
  Calibration calibration;
  calibration.lab = preset("orca-quest");
  calibration.lab.settings.exposure_s = 0.1;
  constexpr double dark_pixels = 1e6;
  const auto open = dark_current_uncertainty(calibration, dark_pixels);
  const auto of = [&](std::string_view name) {
    return std::find_if(open.begin(), open.end(), [&](const Uncertain& one) { return one.name == name; });
  };
  const auto rate = of("dark_current"), spread = of("dark_current_spread");
  ASSERT_NE(rate, open.end());
  ASSERT_NE(spread, open.end());
  const auto shape_at = [&](double coordinate) {
    Lab lab = calibration.lab;
    spread->apply(lab, coordinate);
    return std::get<QcmosDescription>(lab.sensor).dark_gamma_shape;
  };
  EXPECT_NEAR(shape_at(spread->highest), 1.0 / 64, 1e-12);  // nearly all of it in a few pixels
  EXPECT_NEAR(shape_at(spread->lowest), 25, 1e-9);          // all alike
  EXPECT_NEAR(shape_at(-1e3), 25, 1e-9);
  EXPECT_NEAR(spread->value(spread->highest), 8, 1e-12);
  Lab lab = calibration.lab;
  rate->apply(lab, std::log(1.4));
  EXPECT_NEAR(std::get<QcmosDescription>(lab.sensor).dark_rate_e_per_s,
              1.4 * std::get<QcmosDescription>(calibration.lab.sensor).dark_rate_e_per_s, 1e-12);
  EXPECT_GT(rate->width, 0.2);
  EXPECT_TRUE(dark_current_uncertainty(calibration, 1e5).empty());  // some tens of electrons
  calibration.lab = preset("ixon-ultra-897");  // calibrated with its clock-induced charge
  EXPECT_TRUE(dark_current_uncertainty(calibration, dark_pixels).empty());
}

TEST(Uncertain, ARegistersStagesAreOpenWhereItMultipliesLight) {
  Calibration calibration;
  calibration.lab = preset("orca-quest");
  calibration.has_sites = true;
  EXPECT_FALSE(register_uncertainty(calibration));
  calibration.has_sites = false;
  calibration.lab = preset("ixon-ultra-897");
  calibration.lab.settings.em_gain = 300;
  EXPECT_FALSE(register_uncertainty(calibration));
  calibration.has_sites = true;
  calibration.lab.settings.em_gain = 1;
  EXPECT_FALSE(register_uncertainty(calibration));
  calibration.lab.settings.em_gain = 300;
  const auto stages = register_uncertainty(calibration);
  ASSERT_TRUE(stages);
  const auto applied = [&](double coordinate) {
    Lab lab = calibration.lab;
    stages->apply(lab, coordinate);
    return std::get<EmccdDescription>(lab.sensor).register_stages;
  };
  EXPECT_EQ(applied(0), 536);
  EXPECT_EQ(applied(0.1), 536);  // of a few laws, each of which is made once
  EXPECT_EQ(applied(-0.5), 1072);
  EXPECT_EQ(applied(-1.5), 10000);  // the exponential law
  EXPECT_EQ(applied(1.5), 268);
}

// Lines through draws know of no jump: a direction that is drawn about 178 degrees goes on beyond 180, and
// comes round only where it is applied.
TEST(Uncertain, AnAngleGoesRoundWhereItIsAppliedOnly) {
  std::vector<Uncertain> open = effect_prior(*find_effect("vibration_jitter"), 96, 300);
  const auto angle =
      std::find_if(open.begin(), open.end(), [](const Uncertain& one) { return one.cycle > 0; });
  ASSERT_NE(angle, open.end());
  angle->centre = 178;
  angle->width = 8;
  constexpr int stacks = 200;
  const Eigen::VectorXd draws = draw_parameters(open, stacks, 1, 0).col(angle - open.begin());
  EXPECT_GT(draws.maxCoeff(), 190);
  EXPECT_NEAR(draws.mean(), 178, 5 * 8 / std::sqrt(stacks));
  EXPECT_DOUBLE_EQ(angle->within(190), 10);
  EXPECT_DOUBLE_EQ(angle->within(-5), 175);
  EXPECT_DOUBLE_EQ(open[0].within(1e9), open[0].highest);
  Lab lab = preset("orca-quest");
  angle->apply(lab, angle->within(190));
  EXPECT_DOUBLE_EQ(lab.effects["vibration_jitter"][2], 10);
}

// Where nearly all atoms stay, as where half of them do: nothing leads out of what a survival can be, and the
// draws reach as far as counting leaves it open.
TEST(Uncertain, ASurvivalStaysAPartAndIsDrawnAsFarAsItsError) {
  Calibration calibration;
  calibration.lab = preset("orca-quest");
  calibration.has_sites = true;
  calibration.optics.lattice = {.columns = 5, .rows = 5, .a_x = 12, .b_y = 12};
  calibration.optics.covariance = Eigen::MatrixXd::Zero(3 + zernike_terms, 3 + zernike_terms);
  for (const double calibrated : {0.5, 0.9, 0.997}) {
    SCOPED_TRACE(calibrated);
    calibration.lab.scene.survival = calibration.atoms.survival = calibrated;
    calibration.atoms.survival_error = 0.02;
    auto open = calibration_uncertainty(calibration);
    Uncertain& survival =
        *std::find_if(open.begin(), open.end(), [](const Uncertain& one) { return one.name == "survival"; });
    const auto applied = [&](double coordinate) {
      Lab lab = calibration.lab;
      survival.apply(lab, coordinate);
      return lab.scene.survival;
    };
    EXPECT_NEAR(applied(0), calibrated, 1e-9);
    EXPECT_GT(applied(0) - applied(-survival.width), 0.015);  // of twice the error
    EXPECT_LT(applied(0) - applied(-survival.width), 0.06);
    EXPECT_LE(applied(100), 1);
    for (int round = 0; round < 20; ++round) survival.move_to(survival.centre + 0.5);
    EXPECT_NEAR(applied(survival.centre), 1, 1e-9);
    survival.move_to(survival.centre - 0.3);  // and one step leads back
    EXPECT_LT(applied(survival.centre), 0.95);
    // By how much one calibration says more than another is as bounded.
    Calibration all = calibration;
    all.lab.scene.survival = 1;
    EXPECT_NEAR(applied(survival.offset(all, calibration)), 1, 1e-9);
  }
}

// One ray in a stack is as well known as ten in a frame: what is rare differs by orders of magnitude.
TEST(Uncertain, RatesAreLookedForOverAllThatIsAllowed) {
  const Uncertain rate = effect_prior(*find_effect("cosmic_rays"), 96, 300).front();
  EXPECT_NEAR(rate.value(rate.highest), find_effect("cosmic_rays")->parameters.front().maximum, 1e-6);
  EXPECT_LT(rate.value(rate.lowest), 0.01);
}

TEST(Uncertain, AFitMayLeadBeyondWhereAnEffectIsLookedForAndNoFartherThanItGoes) {
  const ParameterDeclaration& scale = find_effect("frame_transfer_smear")->parameters.front();
  Uncertain one = effect_prior(*find_effect("frame_transfer_smear"), 96, 300).front();
  ASSERT_LT(one.value(one.highest), 0.5 * scale.maximum);
  one.width = 0.1;
  const double looked_for = one.highest;
  one.make_room_at(looked_for - 1);
  EXPECT_EQ(one.highest, looked_for);
  one.make_room_at(looked_for + 1);
  EXPECT_DOUBLE_EQ(one.highest, looked_for + 1.2);
  one.make_room_at(looked_for + 100);
  EXPECT_NEAR(one.value(one.highest), scale.maximum, 1e-6 * scale.maximum);
}

// Fringes of which hardly one period is in view are no fringes: they would fit any shading.
TEST(Uncertain, NoLengthInTheImageExceedsTheFrame) {
  const Uncertain scale = effect_prior(*find_effect("scatter_halo"), 72, 300)[1];
  ASSERT_EQ(scale.name, "effects.scatter_halo.scale_px");
  EXPECT_NEAR(scale.value(scale.highest), 72, 1e-9);
  Uncertain period = effect_prior(*find_effect("etaloning_fringes"), 72, 300)[1];
  ASSERT_EQ(period.name, "effects.etaloning_fringes.period_px");
  EXPECT_NEAR(period.value(period.highest), 0.7 * 72, 1e-9);
  period.width = 0.1;
  period.make_room_at(period.highest + 1);
  EXPECT_NEAR(period.value(period.highest), 0.7 * 72, 1e-9);
  // A disturbance's period counts pixels as they are read, row after row.
  EXPECT_GT(effect_prior(*find_effect("emi_stripes"), 72, 300)[1].highest, std::log(600));
}

// Nor are drifts looked for that are slower than the stack shows: of such a one nothing but an offset is
// seen, which calibration takes off.
TEST(Uncertain, DriftsAreAsLongAsTheStackShows) {
  EXPECT_NEAR(effect_prior(*find_effect("bias_drift"), 96, 40)[1].most, std::log(80), 1e-9);
  EXPECT_NEAR(effect_prior(*find_effect("bias_drift"), 96, 300)[1].most, std::log(600), 1e-9);
}

TEST(Uncertain, IsAsWideAsCalibrationsDifferIfTheyDoClearly) {
  Uncertain one, other;
  one.width = other.width = 0.01;
  one.calibrates_apart(0.5);
  EXPECT_EQ(one.width, 0.01) << "two stacks may be anything";
  one.calibrates_apart(0.1);
  EXPECT_NEAR(one.width, std::sqrt((0.25 + 0.01) / 4), 1e-12);
  EXPECT_TRUE(one.calibrates_widely());
  EXPECT_GT(one.bounded(1), 3 * one.width) << "draws have room";
  for (const double difference : {0.02, -0.03, 0.01}) other.calibrates_apart(difference);
  EXPECT_EQ(other.width, 0.01);
  EXPECT_FALSE(other.calibrates_widely());
}

}  // namespace
}  // namespace atomcam
