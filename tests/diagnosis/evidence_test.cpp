#include "diagnosis/evidence.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

Eigen::MatrixXd scattered(Eigen::Index stacks, Eigen::Index statistics, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd z(stacks, statistics);
  for (double& value : z.reshaped()) value = normal(random);
  z.col(1) += 2 * z.col(0);
  return z;
}

/// As the definition has it: a part of the stacks' correlations, the rest of independence.
Eigen::MatrixXd correlations(const Eigen::MatrixXd& own) {
  const Eigen::MatrixXd y = compressed_rows(own);
  const double n = static_cast<double>(y.rows()), p = static_cast<double>(y.cols());
  Eigen::MatrixXd matrix = y.transpose() * y / (n + p);
  matrix.diagonal().array() += p / (n + p);
  return matrix;
}

TEST(Correlation, IsThatOfAllPairsOfStatistics) {
  for (const Eigen::Index stacks : {1, 7, 60}) {
    const Eigen::MatrixXd own = scattered(stacks, 25, 3), x = scattered(4, 25, 5).transpose();
    const Correlation correlation(own);
    const Eigen::MatrixXd all = correlations(own), weighed = all.inverse() * x;
    EXPECT_LT((correlation.weighed(x) - weighed).cwiseAbs().maxCoeff(), 1e-12) << stacks;
    EXPECT_LT((correlation.squares(x) - (x.transpose() * weighed).diagonal()).cwiseAbs().maxCoeff(), 1e-11)
        << stacks;
    EXPECT_NEAR(correlation.log_determinant(), std::log(all.determinant()), 1e-10) << stacks;
  }
}

TEST(Correlation, StatisticsThatMoveTogetherCountOnce) {
  const Correlation correlation(scattered(400, 25, 3));
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(25, 2);
  x(0, 0) = x(1, 0) = 2;      // as they are seen together
  x(0, 1) = 2, x(1, 1) = -2;  // as they never are
  const Eigen::VectorXd squares = correlation.squares(x);
  EXPECT_LT(3 * squares(0), squares(1));
}

/// Statistics of which a tenth is many times as far off in one stack of a hundred.
struct Unsteady {
  double times = 5;
  bool declared = true;
};

/// Of stacks in which some statistics are shifted: how many are seen at the level of a gap.
double seen(double shift, Eigen::Index shifted, const Unsteady& how,
            OmnibusTest::Tails tails = OmnibusTest::Tails::of_these) {
  constexpr Eigen::Index stacks = 240, statistics = 400, unsteady = 40;
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  const auto draw = [&] {
    Eigen::VectorXd z(statistics);
    for (double& v : z) v = normal(random);
    for (Eigen::Index i = 0; i < unsteady; ++i)
      if (random() % 100 == 0) z(i) *= how.times;
    return z;
  };
  Eigen::MatrixXd own(stacks, statistics);
  for (Eigen::Index n = 0; n < stacks; ++n) own.row(n) = draw().transpose();
  std::vector<bool> which(how.declared ? statistics : 0);
  std::fill_n(which.begin(), std::min<std::size_t>(unsteady, which.size()), true);
  const OmnibusTest test(own, which, tails);
  constexpr int trials = 2000;
  int count = 0;
  for (int n = 0; n < trials; ++n) {
    Eigen::VectorXd z = draw();
    for (Eigen::Index i = 0; i < shifted; ++i) z(statistics - 1 - i) += shift;
    count += test.p_value(z) < gap_level;
  }
  return static_cast<double>(count) / trials;
}

TEST(Omnibus, FalseAlarmsAreAsRareAsTold) {
  // 8 of 2000; a null of 240 stacks knows its tail to a factor of two or so.
  for (const auto tails : {OmnibusTest::Tails::of_these, OmnibusTest::Tails::of_all_labs}) {
    EXPECT_LT(seen(0, 0, {}, tails), 4 * gap_level);
    EXPECT_LT(seen(0, 0, {.declared = false}, tails), 4 * gap_level);
    EXPECT_LT(seen(0, 0, {.times = 2, .declared = false}, tails), 4 * gap_level);
  }
}

TEST(Omnibus, UnsteadyStatisticsDoNotHideTheOthers) {
  EXPECT_GT(seen(6, 1, {}), 0.7);
  EXPECT_LT(seen(6, 1, {.declared = false}), 0.2);
  EXPECT_GT(seen(4, 6, {}), 0.8);
  EXPECT_LT(seen(4, 6, {.declared = false}), 0.5);
}

TEST(Omnibus, WhatIsFarOffNowAndThenHidesLessWhereTailsAreKnown) {
  const Unsteady twice{.times = 2, .declared = false};
  EXPECT_GT(seen(5.5, 1, twice, OmnibusTest::Tails::of_all_labs), 0.6);
  EXPECT_LT(seen(5.5, 1, twice, OmnibusTest::Tails::of_these), 0.5);
}

}  // namespace
}  // namespace atomcam
