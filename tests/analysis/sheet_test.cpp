// What families write their statistics with.

#include "analysis/sheet.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace atomcam::analysis {
namespace {

double spread(double square, double freedom) {
  Sheet sheet(false);
  sheet.frames(false, true);
  sheet.put_chi_square("sites", "spread", square, freedom);
  return sheet.take_values().front();
}

TEST(Sheet, AChiSquareOfFewDegreesOfFreedomIsNeverFarOff) {
  constexpr int freedom = 5, draws = 100'000;
  std::mt19937_64 random(5);
  std::chi_squared_distribution<double> chi_square(freedom);
  const auto largest = [&](const auto& of) {
    double sum = 0, squares = 0, least = 1e30, most = -1e30;
    for (int k = 0; k < draws; ++k) {
      const double value = of(chi_square(random));
      sum += value, squares += value * value;
      least = std::min(least, value), most = std::max(most, value);
    }
    const double mean = sum / draws;
    return std::max(mean - least, most - mean) / std::sqrt(squares / draws - mean * mean);
  };
  EXPECT_LT(largest([](double square) { return spread(square, freedom); }), 5.5);
  EXPECT_GT(largest([](double square) { return std::log(square / freedom); }), 6.5);
}

TEST(Sheet, AChiSquareIsItsLogarithmFromOnePerDegreeOfFreedomOn) {
  EXPECT_DOUBLE_EQ(spread(5e6, 5), std::log(1e6));
  EXPECT_DOUBLE_EQ(spread(5, 5), 0);
  constexpr double step = 1e-6;
  EXPECT_NEAR(spread(5 * (1 - step), 5), -step, step * step);
  EXPECT_DOUBLE_EQ(spread(0, 5), -3);
  EXPECT_TRUE(std::isnan(spread(0, 0)));
}

}  // namespace
}  // namespace atomcam::analysis
