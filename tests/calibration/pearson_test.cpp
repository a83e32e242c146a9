#include "calibration/pearson.hpp"

#include <gtest/gtest.h>

namespace atomcam {
namespace {

TEST(Pearson, ProbabilitiesAreTheDensitysIntegral) {
  constexpr double mean = 3, deviation = 0.7;
  for (const double skewness : {0.0, 0.021, 0.1, 0.6, 1.5}) {
    const Pearson law(mean, deviation * deviation, skewness);
    constexpr int steps = 40000;
    constexpr double from = mean - 8 * deviation, to = mean + 20 * deviation, step = (to - from) / steps;
    double below = 0, first = 0, second = 0;
    for (int n = 0; n < steps; ++n) {
      const double x = from + (n + 0.5) * step;
      below += law(x) * step;
      first += x * law(x) * step;
      second += (x - mean) * (x - mean) * law(x) * step;
      if (n % 1000 == 999) {
        ASSERT_NEAR(law.below(x + 0.5 * step), below, 3e-5) << skewness << " at " << x;
      }
    }
    EXPECT_NEAR(first, mean, 1e-3) << skewness;
    EXPECT_NEAR(second, deviation * deviation, 1e-3) << skewness;
  }
}

}  // namespace
}  // namespace atomcam
