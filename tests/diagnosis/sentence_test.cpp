// What a diagnosis says.
#include "diagnosis/sentence.hpp"

#include <gtest/gtest.h>

namespace atomcam {
namespace {

TEST(Sentence, NamesEveryNeighbourOnce) {
  Diagnosis found;
  found.verdict = Verdict::ambiguous;
  for (const char* name : {"row_noise", "hot_pixels"})
    found.effects.push_back({name, "sensor", {}, 0.5, {"dual_adc_peaks", "cosmic_rays"}});
  EXPECT_EQ(sentence_of(found),
            "row_noise and hot_pixels or cosmic_rays, dual_adc_peaks: these frames cannot tell them apart.");
}

TEST(Sentence, ListsWhatIsExplainedInPart) {
  Diagnosis found;
  found.verdict = Verdict::partly_explained;
  found.effects.push_back({"row_noise", "sensor", {}, 0.9, {}});
  found.gap.part_closed = 0.92;
  found.unexplained.looks_like = "stripes";
  for (const auto& [explains, words] : {std::pair(std::vector<std::string>{"a"}, "a"),
                                        {{"a", "b"}, "a and b"},
                                        {{"a", "b", "c"}, "a, b and c"}}) {
    found.gap.explains = explains;
    EXPECT_EQ(sentence_of(found),
              std::string("row_noise closes 92 % of the gap in ") + words +
                  " on held-out frames; what remains, there and elsewhere, is not explained: stripes.");
  }
}

TEST(Sentence, TellsNoFractionOfAGapThatHeldOutFramesDoNotHave) {
  Diagnosis found;
  found.verdict = Verdict::explained;
  found.effects.push_back({"row_noise", "sensor", {}, 0.9, {}});
  found.gap.closed = 0.97;
  EXPECT_EQ(sentence_of(found), "row_noise closes 97 % of the gap on held-out frames.");
  found.verdict = Verdict::ambiguous;
  found.p_gap = 1e-6;
  found.p_after = 0.84;
  const std::string not_shown =
      "row_noise may explain a gap that all frames have (p = 1e-06, with it 0.84) and the held-out half does "
      "not show, which confirms no name.";
  found.gap.shows = false;
  EXPECT_EQ(sentence_of(found), not_shown);
  EXPECT_TRUE(next_measurements(found, true).front().starts_with("as many frames again"));
  found.effects.front().confusable_with = {"emi_stripes"};
  EXPECT_TRUE(sentence_of(found).starts_with("row_noise or emi_stripes may explain")) << sentence_of(found);
  found.gap.shows = true;
  EXPECT_EQ(sentence_of(found), "row_noise or emi_stripes: these frames cannot tell them apart.");
}

TEST(Sentence, OfAgreementSaysHowManyFramesWereLookedAt) {
  Diagnosis diagnosis;
  diagnosis.p_gap = 0.25;
  diagnosis.frames = 1000;
  EXPECT_EQ(sentence_of(diagnosis), "The frames agree with the calibrated plain model (p = 0.25).");
  diagnosis.frames = FrameChoice(1000, 64, 16);
  EXPECT_EQ(sentence_of(diagnosis),
            "The frames agree with the calibrated plain model (p = 0.25; 64 of 1000 were looked at).");
}

TEST(Sentence, SaysWhatCalibrationWarnsOf) {
  Diagnosis diagnosis;
  diagnosis.verdict = Verdict::unexplained;
  diagnosis.unexplained.stage = "sensor";
  diagnosis.unexplained.looks_like = "static";
  EXPECT_EQ(sentence_of(diagnosis).find("warns"), std::string::npos);
  diagnosis.calibration.warnings = {"sites", "gain"};
  EXPECT_TRUE(sentence_of(diagnosis).ends_with(" Calibration warns: sites; gain.")) << sentence_of(diagnosis);
}

}  // namespace
}  // namespace atomcam
