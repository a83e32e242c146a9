#include "diagnosis/diagnosis.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "calibration/notes.hpp"
#include "diagnosis/blind.hpp"
#include "diagnosis/population.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

/// A small stack with one effect (or none), and what a diagnosis says of it.
class Case {
 public:
  explicit Case(const std::string& effect, double strength = 3) {
    BlindOptions options;
    options.rows = options.columns = 64;
    options.seed = 5;
    options.none_share = effect.empty() ? 1 : 0;
    options.pair_share = 0;
    options.weakest = options.strongest = strength;
    if (!effect.empty()) options.effects = {effect};
    const BlindStack stack = make_blind_stack(options, 3);
    StackPlan plan;
    plan.frames = 120;
    plan.dark_frames = 60;
    frames_ = simulate_stack(stack.lab, plan, 1, true);
    darks_ = simulate_stack(stack.lab, plan, 1, false);
    notes_ = parse_notes(stack.notes, "notes");
  }
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
  Notes notes_;
  std::unique_ptr<FrameSequence> frames_, darks_;
};

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

TEST(Diagnose, AnEffectOfTheSceneIsFound) {
  const Diagnosis found = Case("site_brightness_spread").diagnose({"site_brightness_spread"});
  EXPECT_EQ(found.verdict, Verdict::explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "site_brightness_spread");
}

TEST(Diagnose, RefusesEffectsThatDoNotExist) {
  EXPECT_THROW(Case("").diagnose({"row_nois"}), Error);
}

}  // namespace
}  // namespace atomcam
