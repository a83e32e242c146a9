#include "diagnosis/diagnosis.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "calibration/notes.hpp"
#include "diagnosis/blind.hpp"
#include "diagnosis/contenders.hpp"
#include "diagnosis/population.hpp"
#include "effects/effect.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

/// A small stack with one effect (or none) and others beside it, and what a diagnosis says of it.
class Case {
 public:
  explicit Case(const std::string& effect, double strength = 3,
                const std::map<std::string, ParameterValues>& others = {}) {
    BlindOptions options;
    options.rows = options.columns = 64;
    options.seed = 5;
    options.none_share = effect.empty() ? 1 : 0;
    options.pair_share = 0;
    options.weakest = options.strongest = strength;
    if (!effect.empty()) options.effects = {effect};
    BlindStack stack = make_blind_stack(options, 3);
    for (const auto& [name, values] : others) stack.lab.effects[name] = values;
    notes_ = parse_notes(stack.notes, "notes");
    simulate(stack.lab);
  }
  Case(const Lab& lab, Notes notes) : notes_(std::move(notes)) { simulate(lab); }
  Diagnosis diagnose(const std::vector<std::string>& include, const std::vector<std::string>& exclude = {},
                     const std::filesystem::path& cache = {}) {
    DiagnosisOptions options;
    options.include = include;
    options.exclude = exclude;
    options.cache = cache;
    options.threads = 2;
    return atomcam::diagnose(notes_, *frames_, darks_.get(), options);
  }

 private:
  void simulate(const Lab& lab) {
    StackPlan plan;
    plan.frames = 120;
    plan.dark_frames = 60;
    frames_ = simulate_stack(lab, plan, 1, true);
    darks_ = simulate_stack(lab, plan, 1, false);
  }

  Notes notes_;
  std::unique_ptr<FrameSequence> frames_, darks_;
};

/// What was found of the effect when it was judged by itself; null: it was not.
const Hypothesis* judged_alone(const Diagnosis& found, const std::string& effect) {
  for (const Hypothesis& one : found.hypotheses)
    if (one.effects == std::vector{effect} && one.p_value >= 0) return &one;
  return nullptr;
}

TEST(Diagnose, APlainStackHasNoGapAndAKeptResultSaysTheSame) {
  Case plain("");
  const Diagnosis first = plain.diagnose({"row_noise"});
  EXPECT_EQ(first.verdict, Verdict::no_gap);
  const TemporaryFolder cache;
  for (const char* time : {"cold", "warm"}) {
    const Diagnosis again = plain.diagnose({"row_noise"}, {}, cache.path());
    EXPECT_EQ(again.p_gap, first.p_gap) << time;
    EXPECT_EQ(again.gap.before, first.gap.before) << time;
  }
  EXPECT_FALSE(std::filesystem::is_empty(cache.path()));
}

// Single electrons in every pixel alike, half as many as the data sheet says, where the preset has nearly all
// of them in a few pixels.
TEST(Diagnose, ADarkCurrentThatPixelsHaveMoreEvenlyIsNoGap) {
  BlindOptions blind;
  blind.rows = blind.columns = 64;
  blind.none_share = 1;
  std::uint64_t number = 0;
  BlindStack stack = make_blind_stack(blind, number);
  while (stack.lab.kind() != CameraKind::qcmos) stack = make_blind_stack(blind, ++number);
  Notes notes = parse_notes(stack.notes, "notes");
  notes.exposure_s = stack.lab.settings.exposure_s = 0.3;
  notes.dark_e_per_s = 0.02;
  auto& sensor = std::get<QcmosDescription>(stack.lab.sensor);
  sensor.dark_rate_e_per_s = 0.6 * notes.dark_e_per_s;
  sensor.dark_gamma_shape = 2;
  const Diagnosis found = Case(stack.lab, std::move(notes)).diagnose({"row_noise"});
  EXPECT_EQ(found.verdict, Verdict::no_gap) << found.sentence;
}

TEST(Diagnose, AnEffectIsNamedAndClosesTheGapAndWithoutItNothingDoes) {
  Case rows("row_noise");
  const Diagnosis found = rows.diagnose({"row_noise"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "row_noise");
  EXPECT_EQ(found.effects[0].stage, "sensor");
  EXPECT_GT(found.gap.closed, 0.9);
  EXPECT_TRUE(found.lab.effects.contains("row_noise"));
  const Diagnosis withheld = rows.diagnose({"bias_drift"});
  EXPECT_EQ(withheld.verdict, Verdict::unexplained) << withheld.sentence;
  EXPECT_EQ(withheld.unexplained.stage, "sensor");
}

// A few pixels of two levels each: three statistics of hundreds tell, and by the likelihood of all the scan
// has six other effects before theirs.
TEST(Diagnose, WhatTakesTheOddestObservableAwayIsTriedThoughTheScanHasOthersBefore) {
  BlindOptions blind;
  blind.seed = 41;
  blind.rows = blind.columns = 64;
  blind.none_share = 1;
  blind.any_lab = true;
  BlindStack stack = make_blind_stack(blind, 11);
  stack.lab.effects["dual_adc_peaks"] = {0.0025, 9.4, 0, 0.2};
  const Diagnosis found = Case(stack.lab, parse_notes(stack.notes, "notes"))
                              .diagnose({"etaloning_fringes", "field_tilt_defocus", "scatter_halo",
                                         "pixel_crosstalk", "vignetting", "blinking", "stray_light_gradient",
                                         "pupil_apodisation", "dual_adc_peaks"});
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "dual_adc_peaks");
  // Half of the frames is too few for it.
  const auto judged =
      std::find_if(found.hypotheses.begin(), found.hypotheses.end(), [](const Hypothesis& one) {
        return one.effects == std::vector<std::string>{"dual_adc_peaks"} && one.p_value >= 0;
      });
  ASSERT_NE(judged, found.hypotheses.end());
  EXPECT_GT(judged->closed, 0.9);
}

TEST(Diagnose, AnEffectOfTheSceneIsFound) {
  const Diagnosis found = Case("site_brightness_spread").diagnose({"site_brightness_spread"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "site_brightness_spread");
}

TEST(Diagnose, AWeakEffectIsNamedBesideAStrongOneThatLeavesNothingOdd) {
  const Diagnosis found = Case("row_noise", 3, {{"scatter_halo", {0.12, 12}}})
                              .diagnose({"row_noise", "scatter_halo", "hot_pixels"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 2) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "row_noise");
  EXPECT_EQ(found.effects[1].name, "scatter_halo");
  // The strong one explains the frames alone.
  const Hypothesis* alone = judged_alone(found, "row_noise");
  ASSERT_NE(alone, nullptr);
  EXPECT_GE(alone->p_value, reject_level);
}

// Of what a weak effect does only one statistic tells, and over all strengths the strong one scatters by more
// than that; alone it leaves it.
TEST(Diagnose, AnEffectIsFoundByTheOneStatisticThatAStrongOneLeaves) {
  const Diagnosis found =
      Case("row_noise", 5, {{"atom_hopping", {0.2}}}).diagnose({"row_noise", "atom_hopping", "blinking"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 2) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "row_noise");
  EXPECT_EQ(found.effects[1].name, "atom_hopping");
  const Hypothesis* alone = judged_alone(found, "row_noise");
  ASSERT_NE(alone, nullptr);
  EXPECT_NE(alone->why_not.find("light.sites.pairs.exchange"), std::string::npos) << alone->why_not;
}

TEST(Diagnose, TwoClearEffectsAreNamedBeforeOneAlone) {
  const std::vector<std::string> both = {"row_noise", "hot_pixels"};
  const Diagnosis found =
      Case(both[0], 10, {{both[1], {0.01, 300, 1}}}).diagnose({both[0], both[1], "site_brightness_spread"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  EXPECT_EQ(found.effects.size(), 2) << found.sentence;
  for (const std::string& name : both) ASSERT_TRUE(found.lab.effects.contains(name)) << found.sentence;
  EXPECT_NEAR(found.lab.effects.at(both[1]).front(), 0.01, 0.006);
  for (const Hypothesis& one : found.hypotheses)
    EXPECT_FALSE(one.p_value >= 0 && one.effects.size() == 1) << one.effects.front() << " was judged alone";
}

TEST(Diagnose, AnEffectIsNamedForItsOwnObservablesWhereAnotherIsNotKnown) {
  Lab lab = preset("ixon-ultra-897");
  lab.layout = SiteGrid{.columns = 0, .rows = 0};
  lab.place_sites();
  lab.settings.region = {0, 0, 64, 64};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.em_gain = 100;
  ReadoutMode& mode = std::get<EmccdDescription>(lab.sensor).readout_modes.front();
  mode.electrons_per_count = 10;
  mode.read_noise_e = 25;
  std::get<EmccdDescription>(lab.sensor).clock_induced_charge_e = 0.3;
  lab.effects = {{"serial_cic", {1.0}}, {"row_noise", {1.5}}};
  StackPlan plan;
  plan.frames = 120;
  const auto frames = simulate_stack(lab, plan, 1, true);
  const Notes notes = parse_notes(
      R"({"camera": "iXon 897 EMCCD", "shape": [64, 64], "settings": {"em_gain": 100, "preamp_e_per_adu": 10,
          "bias_adu": 200, "read_noise_adu": 2.5, "cic_e": 0.3}})",
      "notes");
  DiagnosisOptions options;
  options.threads = 2;
  options.include = {"serial_cic", "hot_pixels"};
  double furthest = 0;
  options.progress = [&](std::string_view step, double done) {
    EXPECT_GE(done, furthest) << step;
    furthest = done;
  };
  const Diagnosis found = diagnose(notes, *frames, nullptr, options);
  EXPECT_EQ(found.verdict, Verdict::partly_explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "serial_cic");
  const FoundParameter& events = found.effects[0].parameters.front();
  EXPECT_NEAR(events.value, 1.0, 5 * events.error());
  EXPECT_LT(events.error(), 0.2);
  EXPECT_EQ(found.gap.explains, find_effect("serial_cic")->observables);
  EXPECT_GT(found.gap.part_closed, 0.8);
  EXPECT_LT(found.gap.closed, 0.3);
  EXPECT_TRUE(found.unexplained.present);
  // Without it nothing is named.
  options.progress = {};
  options.include = {"hot_pixels"};
  const Diagnosis withheld = diagnose(notes, *frames, nullptr, options);
  EXPECT_EQ(withheld.verdict, Verdict::unexplained) << withheld.sentence;
  EXPECT_EQ(withheld.unexplained.stage, "sensor");
}

TEST(Diagnose, RefusesEffectsThatDoNotExist) {
  EXPECT_THROW(Case("").diagnose({"row_nois"}), Error);
}

}  // namespace
}  // namespace atomcam
