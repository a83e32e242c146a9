// The tables of blind checks, on results made by hand.

#include "diagnosis/blind_score.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace atomcam {
namespace {

BlindResult result(std::vector<BlindEffect> sealed, std::string verdict,
                   std::vector<BlindResult::Found> found = {}) {
  return {.sealed = std::move(sealed),
          .verdict = std::move(verdict),
          .found = std::move(found),
          .unexplained_stage = "sensor",
          .p_gap = 0.5,
          .closed = 0.97};
}
const BlindEffect rows{"row_noise", "sensor", 0.5}, blinking{"blinking", "scene", 0.1};

TEST(BlindScore, CountsAlarmsAccusationsStagesAndCoverage) {
  BlindScore score;
  score.add(result({}, "no_gap"));
  score.add(result({}, "explained", {{"row_noise", "sensor", 0.08, 0.12}}));
  score.add(result({rows}, "explained", {{"row_noise", "sensor", 0.49, 0.56}}));
  score.add(result({rows}, "explained", {{"row_noise", "sensor", 0.57, 0.64}}));
  score.add(result({rows}, "explained", {{"bias_drift", "sensor", 0.9, 1.1}}));
  score.add(result({rows}, "no_gap"));
  score.add(result({blinking}, "unexplained"));
  score.add(result({rows, blinking}, "explained",
                   {{"row_noise", "sensor", 0.47, 0.53}, {"blinking", "scene", 0.09, 0.11}}));
  score.add(result({rows, blinking}, "explained", {{"blinking", "scene", 0.09, 0.11}}));
  const std::string out = score.tables();
  const auto says = [&](const char* line) {
    EXPECT_NE(out.find(line), std::string::npos) << line << "\n" << out;
  };
  says("| row_noise | 4 | 1 | 2 | 0 | 0 | 0 | 1 | 3 of 3 | 0.970 |");
  says("| (pairs) | 2 | 0 | 1 | 1 | 0 | 0 | 0 | 2 of 2 | 0.970 |");
  says("| blinking | 1 | 0 | 0 | 0 | 0 | 1 | 0 | 0 of 1 |  |");
  says("a gap where there is none | 1 of 2 (50.0 %) |");
  says("detected, of stacks with effects | 6 of 7 (85.7 %) |");
  says("a wrong name, of the detected | 1 of 6 (16.7 %) |");
  says("unexplained, of the detected | 1 of 6 (16.7 %) |");
  says("stage right, of the detected | 5 of 6 (83.3 %) |");
  says("both named, of detected pairs | 1 of 2 (50.0 %) |");
  says("in its interval (68 % expected) | 4 of 5 (80.0 %) |");
  says("| row_noise | bias_drift (1), no_gap (1), row_noise (2) |");
  says("| row_noise + blinking | blinking (1), row_noise + blinking (1) |");
}

TEST(BlindScore, PValuesAreAskedWhetherTheyAreUniform) {
  std::vector<double> even, crowded;
  for (int k = 0; k < 400; ++k) {
    even.push_back((k + 0.5) / 400);
    crowded.push_back(std::pow((k + 0.5) / 400, 1.5));
  }
  EXPECT_GT(uniform_p_value(even), 0.99);
  EXPECT_LT(uniform_p_value(crowded), 1e-3);
  // 5 % are beyond 1.3581, in units that for 400 values are 1 / 20.1255.
  std::vector<double> shifted = even;
  for (double& p : shifted) p = std::min(1.0, p + 1.3581 / 20.1255 - 0.5 / 400);
  EXPECT_NEAR(uniform_p_value(shifted), 0.05, 1e-5);
}

}  // namespace
}  // namespace atomcam
