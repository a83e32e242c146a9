#include "diagnosis/detection_strength.hpp"

#include <gtest/gtest.h>

#include "diagnosis/blind.hpp"
#include "diagnosis/diagnosis.hpp"

namespace atomcam {
namespace {

// Diagnoses of other stacks, each calibrated for itself: hardly one shows a gap at 0.4 of the strength, all
// do at twice, also of an effect that calibrating takes for another focus in part.
TEST(DetectionStrength, IsWhereDiagnosesBeginToSeeTheEffect) {
  BlindOptions options;
  options.rows = options.columns = 48;
  options.none_share = 1;
  const BlindStack blind = make_blind_stack(options, 2);
  const Notes notes = parse_notes(blind.notes, "notes");
  StackPlan plan;
  plan.frames = 60;
  plan.dark_frames = 30;
  const DetectionGround ground(blind.lab, notes, plan.frames.count(), plan.dark_frames.count(), 2);
  const EffectDeclaration& effect = *find_effect("pixel_crosstalk");
  ParameterValues values;
  for (const ParameterDeclaration& one : effect.parameters) values.push_back(one.default_value);
  const DetectionStrength found = ground.of(effect, values);
  EXPECT_TRUE(found.reached);
  EXPECT_GT(found.matched_filter, 0.1 * found.strength);
  EXPECT_LT(found.matched_filter, found.strength);
  const auto seen = [&](double multiple) {
    Lab lab = blind.lab;
    values.front() = multiple * found.strength;
    lab.effects[effect.name] = values;
    int gaps = 0;
    for (std::uint64_t k = 0; k < 3; ++k) {
      const auto light = simulate_stack(lab, plan, 1000 + k, true),
                 darks = simulate_stack(lab, plan, 1000 + k, false);
      DiagnosisOptions how;
      how.where_only = true;
      how.threads = 2;
      gaps += diagnose(notes, *light, darks.get(), how).p_gap < gap_level;
    }
    return gaps;
  };
  EXPECT_LE(seen(0.4), 1);
  EXPECT_EQ(seen(2), 3);
}

// Nothing brings an effect of the sensor that is at its largest already into sight.
TEST(DetectionStrength, SaysWhenNoStrengthIsEnough) {
  BlindOptions options;
  options.rows = options.columns = 48;
  options.none_share = 1;
  const BlindStack blind = make_blind_stack(options, 2);
  const DetectionGround ground(blind.lab, parse_notes(blind.notes, "notes"), 40, 20, 2);
  EffectDeclaration faint = *find_effect("row_noise");
  faint.parameters.front().default_value *= 0.01;
  faint.parameters.front().maximum = 2 * faint.parameters.front().default_value;
  const DetectionStrength found = ground.of(faint, {faint.parameters.front().default_value});
  EXPECT_FALSE(found.reached);
  EXPECT_DOUBLE_EQ(found.strength, faint.parameters.front().maximum);
  // What stacks with and without it differ by is chance, and not taken for a distance.
  EXPECT_DOUBLE_EQ(found.matched_filter, 0);
}

}  // namespace
}  // namespace atomcam
