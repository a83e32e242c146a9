#include "diagnosis/fit.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "calibration/notes.hpp"
#include "diagnosis/blind.hpp"
#include "diagnosis/wider_estimate.hpp"
#include "effects/effect.hpp"

namespace atomcam {
namespace {

/// A small stack with one effect, calibrated and judged by the plain model.
struct StackWithEffect {
  BlindStack stack;
  StackPlan plan;
  CalibrationInput input;
  Calibration calibration;
  BatteryValues values;
  RealStack real;
  Model plain;

  StackWithEffect(const std::string& effect, double strength, std::size_t frames) {
    BlindOptions options;
    options.rows = options.columns = 48;
    options.seed = 5;
    options.none_share = options.pair_share = 0;
    options.weakest = options.strongest = strength;
    options.effects = {effect};
    stack = make_blind_stack(options, 3);
    plan.frames = frames;
    plan.dark_frames = 30;
    plan.threads = 2;
    const auto light = simulate_stack(stack.lab, plan, 1, true),
               darks = simulate_stack(stack.lab, plan, 1, false);
    input.notes = parse_notes(stack.notes, "notes");
    input.frames = light.get();
    input.darks = darks.get();
    calibration = calibrate(input);
    plan.model = calibration.model;
    plan.split = split_of(plan.frames.count(), 5);
    values = measure(plan.model, *light, darks.get(), plan.split);
    real = {&values, &calibration, &input.notes};
    plain = plain_model(real, 60, plan);
    input.frames = input.darks = nullptr;
  }
  Model with_effect() const {
    const std::string& name = stack.effects.front().name;
    Model model;
    model.effects = {name};
    model.lab = plain.lab;
    model.open = plain.open;
    model.first_effect_parameter = plain.first_effect_parameter;
    for (Uncertain& one : effect_prior(*find_effect(name), 96, 300)) {
      one.centre = one.usual;
      one.width = 0.05 * (one.highest - one.lowest);
      model.open.push_back(std::move(one));
    }
    return model;
  }
};

TEST(Fit, ReturnsFromAStepThatLedAstrayAndGoesWhereNobodyLooked) {
  const StackWithEffect it("row_noise", 3, 60);
  const StackPlan& plan = it.plan;
  const Model& plain = it.plain;
  Model model = it.with_effect();
  const auto strength = static_cast<std::size_t>(plain.first_effect_parameter);
  const FitGround ground{&plain, it.real};
  fit(model, ground, 4, plan, numbers_of("first rounds"));
  const double reached = model.distance, there = model.nearest[strength].centre;
  EXPECT_LT(reached, plain_distance(ground, plan));

  // Farther than three steps could lead back.
  const double range = model.open[strength].highest - model.open[strength].lowest;
  model.open[strength].centre = model.open[strength].highest;
  model.open[strength].width = 0.02 * range;
  fit(model, ground, 3, plan, numbers_of("more rounds"));
  EXPECT_LE(model.distance, reached);
  EXPECT_NEAR(model.open[strength].centre, there, 0.1 * range);

  // Looked for among strengths that are all too low.
  Model weaker = it.with_effect();
  weaker.open[strength].highest = there - 0.7;
  weaker.open[strength].centre = there - 1.2;
  // What is known better than by calibration stays where it is, and only that.
  weaker.open[0].held = true;
  fit(weaker, ground, 6, plan, numbers_of("from below"));
  EXPECT_NEAR(weaker.open[strength].centre, there, 0.1 * range);
  EXPECT_EQ(weaker.open[0].centre, plain.open[0].centre);
  EXPECT_NE(model.open[0].centre, plain.open[0].centre);
}

// A shaking image is blurred as a defocused one is: with too little of it, and optics that calibrate as the
// frames do, all is nearly as it should be. The way on from there shows in stacks with other optics.
TEST(Fit, OpticsThatMakeUpForAnEffectDoNotHideItsStrength) {
  const StackWithEffect it("vibration_jitter", 1, 150);
  const ParameterValues& truth = it.stack.lab.effects.at("vibration_jitter");
  Model model = it.with_effect();
  const Eigen::Index amplitude = model.first_effect_parameter, slow_share = amplitude + 3;
  const auto open = [&](Eigen::Index k) -> Uncertain& { return model.open[static_cast<std::size_t>(k)]; };
  for (std::size_t k = 0; k < truth.size(); ++k) {
    Uncertain& one = open(amplitude + static_cast<Eigen::Index>(k));
    one.centre = one.coordinate_of(truth[k]);
  }
  const double right = open(amplitude).centre;
  open(amplitude).centre -= 0.2;
  open(slow_share).centre += 0.2;
  for (std::uint64_t round = 0; round < 4; ++round)
    recalibrate(model, it.real, it.plan, numbers_of("recalibration") + round * 100);
  judge(model, it.values, 90, it.plan, numbers_of("narrow"), &it.plain);
  EXPECT_GT(model.p_value, 0.05) << "nothing to be seen of it";
  // Other stacks estimate otherwise, by about an error.
  constexpr int sets = 3;
  double estimate = 0;
  for (int set = 0; set < sets; ++set) {
    model.wider = {};
    const std::string name = "wide" + std::string(static_cast<std::size_t>(set), 'x');
    EXPECT_TRUE(estimate_with_wider_optics(model, it.values, 90, it.plan, numbers_of(name)));
    EXPECT_EQ(model.wider.stacks(), 180);
    estimate += model.estimate(amplitude) / sets;
  }
  EXPECT_NEAR(estimate, right, 1.5 * model.error(amplitude));
  EXPECT_LT(model.error(amplitude), 0.15);
}

// A bias that walks many times as far as it did scatters so widely that nothing is far from it.
TEST(Fit, WhatScattersWidelyIsNotNearForThat) {
  const StackWithEffect it("bias_drift", 2, 100);
  const ParameterValues& truth = it.stack.lab.effects.at("bias_drift");
  const auto rms = static_cast<std::size_t>(it.plain.first_effect_parameter);
  const FitGround ground{&it.plain, it.real};
  const auto fitted = [&](double times, int rounds, const std::string& step) {
    Model model = it.with_effect();
    for (std::size_t k = 0; k < 2; ++k)
      model.open[rms + k].centre = model.open[rms + k].coordinate_of(truth[k]);
    model.open[rms].centre += std::log(times);
    fit(model, ground, rounds, it.plan, numbers_of(step));
    return model;
  };
  constexpr int looks = 5;
  double nearer = 0, likelier = 0;
  for (int k = 0; k < looks; ++k) {
    const std::string step = "look " + std::to_string(k);
    const Model right = fitted(1, 1, step), longer = fitted(4, 1, step);
    nearer += (longer.distance - right.distance) / looks;
    likelier += (longer.unlikeliness - right.unlikeliness) / looks;
  }
  EXPECT_LT(nearer, 0.2) << "nothing to be told apart";
  EXPECT_GT(likelier, 0.3);
  // Nor do fits stay there. How much shorter a walk one ends at, single stacks hardly say: the middle of
  // three.
  std::vector<Model> ends;
  for (int k = 0; k < 3; ++k) ends.push_back(fitted(4, 8, "from a longer walk " + std::to_string(k)));
  const auto middle = [&](const auto& of) {
    std::vector<double> values;
    for (const Model& end : ends) values.push_back(of(end));
    std::sort(values.begin(), values.end());
    return values[1];
  };
  EXPECT_LT(middle([rms](const Model& end) { return end.nearest[rms].centre; }),
            it.with_effect().open[rms].coordinate_of(truth[0]) + std::log(2.0));
  // Such stacks do not calibrate alike, and the bias is drawn accordingly; the optics of all are the same.
  for (std::size_t k = 0; k < rms; ++k) {
    const Uncertain& plain = it.plain.open[k];
    const auto wider = [&](const Model& end) { return end.open[k].width / plain.width; };
    if (plain.name == "bias") {
      EXPECT_GT(middle(wider), 5);
    } else if (plain.shared && plain.width > 0) {
      for (const Model& end : ends) EXPECT_EQ(wider(end), 1);
    }
  }
}

}  // namespace
}  // namespace atomcam
