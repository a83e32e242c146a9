// What a contributor does to add an effect: one file with its declaration, two lines in the catalogue. This
// program has a catalogue of its own, with an effect that nothing else in the project has heard of; its
// effect_catalogue() and find_effect() take the place of those of src/effects/catalogue.cpp when it is
// linked.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "base/samplers.hpp"
#include "calibration/notes.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/population.hpp"
#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class ColumnNoise : public Effect {
 public:
  explicit ColumnNoise(const ParameterValues& values) : sigma_counts_(values[0]) {}

  void apply_to_counts(int, std::span<float> analog_counts, const FrameContext& context) const override {
    RandomStream random = context.random("column");  // every row sees the same offsets
    for (float& counts : analog_counts) counts += static_cast<float>(sigma_counts_ * sample_normal(random));
  }

 private:
  double sigma_counts_;
};

EffectDeclaration column_noise() {
  return {.name = "column_noise",
          .plane = Plane::counts,
          .summary = "Every column of every frame has its own offset.",
          .reference = "",
          .parameters = {{.key = "sigma_counts",
                          .unit = "counts",
                          .minimum = 0,
                          .maximum = 50,
                          .default_value = 0.5,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms of a column's offset (normal)."}},
          .observables = {"column_means"},
          .make = make_effect<ColumnNoise>};
}

}  // namespace

// Those that the cameras' presets have, and two more.
EffectDeclaration serial_cic();
EffectDeclaration row_noise();
EffectDeclaration bias_drift();

std::span<const EffectDeclaration> effect_catalogue() {
  static const std::array catalogue = {column_noise(), serial_cic(), row_noise(), bias_drift()};
  return catalogue;
}

const EffectDeclaration* find_effect(std::string_view name) {
  const auto all = effect_catalogue();
  const auto found = std::find_if(all.begin(), all.end(), [&](const auto& one) { return one.name == name; });
  return found == all.end() ? nullptr : &*found;
}

namespace {

constexpr double sigma_counts = 1.2;

Diagnosis diagnose_columns(const DiagnosisOptions& options) {
  const Notes notes = parse_notes(
      R"({"camera": "iXon", "shape": [48, 48], "settings": {"em_gain": 300, "preamp_e_per_adu": 4.5,
          "read_noise_adu": 4, "cic_e": 0.01, "stray_e_per_s": 1}})",
      "notes");
  Lab lab = lab_of_notes(notes);
  lab.effects["column_noise"] = {sigma_counts};
  StackPlan plan;
  plan.frames = 60;
  const auto frames = simulate_stack(lab, plan, 1, true);
  return diagnose(notes, *frames, nullptr, options);
}

TEST(NewEffect, IsFoundAndClosesTheGap) {
  DiagnosisOptions options;
  options.include = {"column_noise", "row_noise", "bias_drift"};
  options.threads = 2;
  const Diagnosis found = diagnose_columns(options);
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "column_noise");
  EXPECT_EQ(found.effects[0].stage, "sensor");
  ASSERT_EQ(found.effects[0].parameters.size(), 1);
  const FoundParameter& sigma = found.effects[0].parameters[0];
  EXPECT_EQ(sigma.name, "sigma_counts");
  EXPECT_NEAR(sigma.value, sigma_counts, 5 * sigma.error());
  EXPECT_TRUE(found.lab.effects.contains("column_noise"));
}

TEST(NewEffect, IsNotTakenForAnotherOneWhenItIsWithheld) {
  DiagnosisOptions options;
  options.exclude = {"column_noise", "serial_cic"};
  options.threads = 2;
  const Diagnosis withheld = diagnose_columns(options);
  EXPECT_EQ(withheld.verdict, Verdict::unexplained) << withheld.sentence;
  EXPECT_TRUE(withheld.effects.empty());
}

}  // namespace
}  // namespace atomcam
