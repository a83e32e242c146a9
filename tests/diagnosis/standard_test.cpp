// How stacks are judged, on a population made by hand: statistics that follow two parameters along straight
// lines.
#include "diagnosis/standard.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

constexpr Eigen::Index stacks = 200, statistics = 30, parameters = 2;

struct Lines {
  Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(statistics, parameters);
  std::mt19937 random{7};
  std::normal_distribution<double> normal;

  Lines() {
    for (Eigen::Index i = 0; i < 10; ++i) slopes(i, 0) = 1 + 0.1 * static_cast<double>(i);
    for (Eigen::Index i = 8; i < 16; ++i) slopes(i, 1) = 2;
  }
  Eigen::VectorXd stack(const Eigen::VectorXd& at) {
    Eigen::VectorXd values = slopes * at;
    for (double& value : values) value += normal(random);
    return values;
  }
  Population population(double width = 1, Eigen::Index count = stacks) {
    Population made;
    made.draws.resize(count, parameters);
    made.whole.resize(count, statistics);
    for (Eigen::Index n = 0; n < count; ++n) {
      for (Eigen::Index j = 0; j < parameters; ++j) made.draws(n, j) = width * normal(random);
      made.whole.row(n) = stack(made.draws.row(n).transpose()).transpose();
    }
    return made;
  }
};

TEST(Standard, TakesOffWhatAParameterExplains) {
  Lines lines;
  const Standard standard(lines.population(), Part::whole);
  const Eigen::VectorXd z = standard.judge(lines.stack(Eigen::Vector2d(1.5, -1)));
  EXPECT_LT(z.cwiseAbs().maxCoeff(), 4);
  EXPECT_NEAR(standard.estimate(lines.stack(Eigen::Vector2d(1.5, -1)))(0), 1.5,
              5 * standard.estimate_error()(0));
}

// Draws as narrow as the error leave slopes in the noise: the plain estimate stays near their middle, the one
// drawn out is right in the mean and knows how far it scatters.
TEST(Standard, AnEffectIsNotDrawnTowardsTheMiddleOfItsDraws) {
  Lines lines;
  const double width = 0.12, truth = 0.36;
  double plain = 0, sum = 0, squares = 0, error = 0;
  constexpr int populations = 40, looks = 25;
  for (int n = 0; n < populations; ++n) {
    const Standard standard(lines.population(width), Part::whole);
    double middle = 0;
    for (int k = 0; k < looks; ++k) {
      const Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(truth, 0));
      const Standard::Estimate out = standard.drawn_out(stack, 0);
      plain += standard.estimate(stack)(0) / (populations * looks);
      middle += out.value(0) / looks;
      squares += std::pow(out.value(0) - truth, 2) / (populations * looks);
      error += std::pow(out.error(0), 2) / populations / looks;
    }
    sum += middle / populations;
  }
  EXPECT_LT(plain, 0.85 * truth);
  EXPECT_NEAR(sum, truth, 0.05);
  EXPECT_NEAR(std::sqrt(error / squares), 1, 0.25);
}

// As few stacks as there are say by chance that statistics go together: one that knows of no parameter, and
// is far off for a reason of its own, must not pull the parameters along.
TEST(Standard, AStatisticThatKnowsOfNoParameterSaysNothingOfOne) {
  Lines lines;
  const Standard standard(lines.population(), Part::whole);
  const Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(1, 0));
  Eigen::VectorXd off = stack;
  off.tail(statistics - 16).array() += 4;
  EXPECT_LT((standard.estimate(off) - standard.estimate(stack)).cwiseAbs().maxCoeff(),
            0.05 * standard.estimate_error().minCoeff());
}

// One outlier where no stack has any is not a thousand deviations, a hundred where each has three are many.
TEST(Standard, APartOfAnOutlierMeansNothing) {
  Lines lines;
  Population population = lines.population();
  population.outliers.assign(statistics, false);
  population.outliers[20] = population.outliers[21] = true;
  for (Eigen::Index n = 0; n < stacks; ++n) {
    for (const int i : {20, 22}) population.whole(n, i) = 1e-4 * std::fabs(population.whole(n, i));
    population.whole(n, 21) = std::log1p(std::max(0.0, 3 + 0.5 * population.whole(n, 21)));
  }
  const Standard standard(population, Part::whole);
  Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(0, 0));
  stack(20) = stack(22) = std::log1p(0.05);
  stack(21) = std::log1p(100);
  const Eigen::VectorXd z = standard.judge(stack);
  EXPECT_LT(std::fabs(z(20)), 2);
  EXPECT_GT(z(21), 10);
  EXPECT_GT(z(22), 100);  // a number that is known to four digits is another matter
  stack(20) = std::log1p(30);
  EXPECT_GT(standard.judge(stack)(20), 10);
}

// A bin of a histogram into which something falls in one stack of thirty: whether its spread is that of the
// many or that of the few is chance, and differs between all stacks and those without a fold.
TEST(Standard, WhatAFewOfItsStacksHaveIsNoDifference) {
  constexpr Eigen::Index rare = statistics - 1;
  for (const int few : {1, 2, 3, 4, 5}) {
    Lines lines;
    Population population = lines.population(1, 90);
    population.whole.col(rare).setZero();
    for (int k = 0; k < few; ++k) population.whole(9 + 11 * k, rare) = 0.016;
    Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(0, 0));
    stack(rare) = 0.016;
    EXPECT_LT(std::fabs(Standard(population, Part::whole).judge(stack)(rare)), 5) << few;
  }
}

// That none of a few hundred stacks has an event, or one of them, says how often it comes, and no more than
// that.
TEST(Standard, OneEventIsAsRareAsTheStacksCanSay) {
  constexpr Eigen::Index rare = statistics - 1;
  for (const int stacks_with_one : {0, 1, 2}) {
    Lines lines;
    Population population = lines.population(1, 240);
    population.whole.col(rare).setZero();
    for (int k = 0; k < stacks_with_one; ++k) population.whole(7 + 11 * k, rare) = std::asinh(1);
    const Standard standard(population, Part::whole);
    const auto of_events = [&](double number) {
      Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(0, 0));
      stack(rare) = std::asinh(number);
      return standard.judge(stack)(rare);
    };
    EXPECT_GT(of_events(1), 2) << stacks_with_one;
    EXPECT_LT(of_events(1), 3) << stacks_with_one;
    EXPECT_GT(of_events(5), 5.5) << stacks_with_one;
    EXPECT_GT(of_events(100), 13) << stacks_with_one;
  }
}

// A calibration's parameter is left where it is known to be.
TEST(Standard, DrawsOutFromTheFirstOnly) {
  Lines lines;
  const Standard standard(lines.population(0.12), Part::whole);
  const Eigen::VectorXd stack = lines.stack(Eigen::Vector2d(0.36, 0.36));
  const Standard::Estimate out = standard.drawn_out(stack, 1);
  EXPECT_EQ(out.value(0), standard.estimate(stack)(0));
  EXPECT_EQ(out.error(0), standard.estimate_error()(0));
  EXPECT_NE(out.value(1), standard.estimate(stack)(1));
}

// A parameter far off is a gap for the frames that were calibrated, but not for an effect's stack that would
// have been calibrated elsewhere; what no parameter does is one for both.
TEST(Standard, FollowsAStackThatCalibratesElsewhere) {
  Lines lines;
  const Standard standard(lines.population(), Part::whole);
  Eigen::VectorXd far = lines.stack(Eigen::Vector2d(10, 0));
  EXPECT_GT(standard.judge(far).cwiseAbs().maxCoeff(), 6);
  EXPECT_LT(standard.judge_recalibrated(far).cwiseAbs().maxCoeff(), 4);
  far(25) += 9;
  EXPECT_NEAR(standard.judge_recalibrated(far)(25), 9, 3);
}

/// Many nulls of few samples: how often new samples are beyond what is told, on average over the nulls; the
/// error is as large as nulls scatter.
struct Beyond {
  double mean, error;
};
Beyond beyond(double level, NullDistribution::KnownTail known) {
  constexpr int nulls = 4000, trials = 1000;
  std::mt19937 random(3);
  std::exponential_distribution<double> law;
  double sum = 0, square = 0;
  for (int n = 0; n < nulls; ++n) {
    std::vector<double> samples(240);
    for (double& one : samples) one = law(random);
    const NullDistribution null(samples, known);
    double beyond = 0;
    for (int k = 0; k < trials; ++k) beyond += null.p_value(law(random)) < level;
    beyond /= trials;
    sum += beyond, square += beyond * beyond;
  }
  const double mean = sum / nulls;
  return {mean, std::sqrt((square / nulls - mean * mean) / nulls)};
}

// A scale that is taken for known is exceeded a fifth too often.
TEST(NullDistribution, TailsAreAsUncertainAsTheSamplesLeaveThem) {
  for (const double level : {0.05, 0.005}) {
    const Beyond seen = beyond(level, {});
    EXPECT_NEAR(seen.mean, level, 5 * seen.error) << level;
    EXPECT_LT(seen.error, 0.02 * level);
  }
}

TEST(NullDistribution, AKnownTailIsToldTheBetterFor) {
  const Beyond by_samples = beyond(0.005, {}), known = beyond(0.005, {1, 200});
  EXPECT_NEAR(known.mean, 0.005, 0.0003);
  EXPECT_LT(known.error, 0.8 * by_samples.error);
}

}  // namespace
}  // namespace atomcam
