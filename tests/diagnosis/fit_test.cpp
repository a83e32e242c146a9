#include "diagnosis/fit.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "calibration/notes.hpp"
#include "diagnosis/blind.hpp"
#include "effects/effect.hpp"

namespace atomcam {
namespace {

TEST(Fit, ReturnsFromAStepThatLedAstrayAndGoesWhereNobodyLooked) {
  BlindOptions options;
  options.rows = options.columns = 48;
  options.seed = 5;
  options.none_share = options.pair_share = 0;
  options.weakest = options.strongest = 3;
  options.effects = {"row_noise"};
  const BlindStack stack = make_blind_stack(options, 3);
  StackPlan plan;
  plan.frames = 60;
  plan.dark_frames = 30;
  plan.threads = 2;
  const auto frames = simulate_stack(stack.lab, plan, 1, true),
             darks = simulate_stack(stack.lab, plan, 1, false);
  CalibrationInput input;
  input.notes = parse_notes(stack.notes, "notes");
  input.frames = frames.get();
  input.darks = darks.get();
  const Calibration calibration = calibrate(input);
  plan.model = calibration.model;
  plan.split = split_of(plan.frames, 5);
  const BatteryValues values = measure(plan.model, *frames, darks.get(), plan.split);
  const RealStack real{&values, &calibration, &input.notes};
  const Model plain = plain_model(real, 60, plan);

  const auto with_row_noise = [&] {
    Model model;
    model.effects = options.effects;
    model.lab = plain.lab;
    model.open = plain.open;
    model.first_effect_parameter = plain.first_effect_parameter;
    for (Uncertain& one : effect_prior(*find_effect("row_noise"), 96, 300)) {
      one.centre = one.usual;
      one.width = 0.05 * (one.highest - one.lowest);
      model.open.push_back(std::move(one));
    }
    return model;
  };
  Model model = with_row_noise();
  const auto strength = static_cast<std::size_t>(plain.first_effect_parameter);
  const FitGround ground{&plain, real};
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
  Model weaker = with_row_noise();
  weaker.open[strength].highest = there - 0.7;
  weaker.open[strength].centre = there - 1.2;
  // What is known better than by calibration stays where it is, and only that.
  weaker.open[0].held = true;
  fit(weaker, ground, 6, plan, numbers_of("from below"));
  EXPECT_NEAR(weaker.open[strength].centre, there, 0.1 * range);
  EXPECT_EQ(weaker.open[0].centre, plain.open[0].centre);
  EXPECT_NE(model.open[0].centre, plain.open[0].centre);
}

}  // namespace
}  // namespace atomcam
