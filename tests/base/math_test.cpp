#include "base/math.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/math/special_functions/erf.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>

#include "base/random.hpp"

namespace atomcam {
namespace {

// Bounds are those that base/math.hpp states.

TEST(Math, LogarithmAndExponentialKeepTheirStatedAccuracy) {
  RandomStream random(1, stream_id("test/math"), 0, 0);
  for (int i = 0; i < 200000; ++i) {
    const double x = std::ldexp(1 + random.uniform53(), static_cast<int>(random() % 2000) - 1000);
    ASSERT_LE(std::fabs(math::log(x) - std::log(x)), 1e-15 * std::fabs(std::log(x))) << x;
    const double near_one =
        1 + (random.uniform53() - 0.5) * std::ldexp(1.0, -static_cast<int>(random() % 40));
    ASSERT_LE(std::fabs(math::log(near_one) - std::log(near_one)), 1e-15 * std::fabs(std::log(near_one)))
        << near_one;
    const double y = (random.uniform53() - 0.5) * 1400;
    ASSERT_LE(std::fabs(math::exp(y) - std::exp(y)), 1e-15 * std::exp(y)) << y;
  }
  EXPECT_EQ(math::exp(0), 1);
  EXPECT_EQ(math::exp(-709), 0);
  EXPECT_TRUE(std::isinf(math::exp(710)));
  EXPECT_EQ(math::log(1), 0);
}

TEST(Math, SineAndCosineOfTurns) {
  RandomStream random(2, stream_id("test/math"), 0, 0);
  for (int i = 0; i < 200000; ++i) {
    const double x = (random.uniform53() - 0.5) * std::ldexp(1.0, static_cast<int>(random() % 41));
    const long double angle =
        2 * 3.14159265358979323846264338327950288L * (x - std::floor(static_cast<long double>(x)));
    ASSERT_LE(std::fabs(math::sin_turns(x) - static_cast<double>(sinl(angle))), 1e-15) << x;
    ASSERT_LE(std::fabs(math::cos_turns(x) - static_cast<double>(cosl(angle))), 1e-15) << x;
  }
}

TEST(Math, LogGamma) {
  for (double x = 1e-3; x < 1e9; x *= 1.013) {
    const double expected = boost::math::lgamma(x);
    ASSERT_LE(std::fabs(math::log_gamma(x) - expected), 1e-12 * std::max(1.0, std::fabs(expected))) << x;
  }
}

TEST(Math, NormalQuantileInvertsTheNormalLaw) {
  for (double p = 1e-300; p < 0.5; p *= 1.1) {
    const double expected = -std::sqrt(2.0) * boost::math::erfc_inv(2 * p);
    ASSERT_LE(std::fabs(math::normal_quantile(p) - expected), 2e-15 * std::max(1.0, std::fabs(expected)))
        << p;
    if (p > 1e-10) {
      ASSERT_EQ(math::normal_quantile(1 - p), -math::normal_quantile(1 - (1 - p)));
    }
  }
  EXPECT_EQ(math::normal_quantile(0.5), 0);
}

}  // namespace
}  // namespace atomcam
