// What a lens does to an array against sites that are displaced each on its own.

#include "analysis/distortion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace atomcam::analysis {
namespace {

class Distortion : public testing::TestWithParam<int> {
 protected:
  Distortion() {
    const int edge = GetParam();
    for (int row = 0; row < edge; ++row)
      for (int column = 0; column < edge; ++column) {
        x_.push_back(2.0 * column / (edge - 1) - 1);
        y_.push_back(2.0 * row / (edge - 1) - 1);
        weight_.push_back(1 + 0.1 * column);
      }
  }
  template <class Shift>
  double of(const Shift& shift, double scatter) {
    std::vector<double> d;
    for (std::size_t s = 0; s < x_.size(); ++s) d.push_back(shift(x_[s], y_[s]) + scatter * normal_(random_));
    return log_distortion(x_, y_, weight_, d);
  }

  std::vector<double> x_, y_, weight_;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
};

TEST_P(Distortion, OfScatteredSitesIsThatOfChance) {
  // F with 7 and sites - 10 degrees of freedom: variance of its logarithm about 2 / 7 + 2 / (sites - 10).
  constexpr int times = 2000;
  double sum = 0, square = 0;
  for (int n = 0; n < times; ++n) {
    const double value = of([](double, double) { return 0.0; }, 1);
    sum += value, square += value * value;
  }
  const double rest = static_cast<double>(x_.size()) - 10, mean = sum / times,
               variance = square / times - mean * mean;
  // Of a chi-square of k degrees, the logarithm of its k-th part has the mean -1 / k, to the second order.
  EXPECT_NEAR(mean, -1.0 / 7 + 1 / rest, 0.05);
  EXPECT_NEAR(variance, 2.0 / 7 + 2 / rest, 0.12);
}

TEST_P(Distortion, OfALensStandsOut) {
  const auto barrel = [](double x, double y) { return 3 * x * (x * x + y * y); };
  const auto keystone = [](double x, double y) { return 3 * x * y; };
  EXPECT_GT(of(barrel, 0.3), 2.5);
  EXPECT_GT(of(keystone, 0.3), 2.5);
}

TEST_P(Distortion, KnowsNothingOfPlaceScaleAndAngles) {
  const auto lattice = [](double x, double y) { return 100 + 30 * x - 20 * y; };
  std::mt19937_64 before = random_;
  const double with = of(lattice, 1);
  random_ = before;
  normal_.reset();
  EXPECT_NEAR(with, of([](double, double) { return 0.0; }, 1), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Grids, Distortion, testing::Values(5, 8, 20));

TEST(DistortionOfFewSites, IsNotANumber) {
  const std::vector<double> nine(9, 1.0);
  EXPECT_TRUE(std::isnan(log_distortion(nine, nine, nine, nine)));
}

}  // namespace
}  // namespace atomcam::analysis
