#include "diagnosis/rivals.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

constexpr Eigen::Index statistics = 200, moved = 12;

/// Statistics that no parameter moves, of which one model moves a dozen by some deviations, now more and now
/// less.
class MadeUp {
 public:
  Eigen::MatrixXd stacks(Eigen::Index count, double by) {
    Eigen::MatrixXd all = Eigen::MatrixXd::NullaryExpr(count, statistics, [&] { return normal_(random_); });
    for (Eigen::Index n = 0; n < count; ++n)
      all.row(n).head(moved).array() += by * (1 + 0.3 * normal_(random_));
    return all;
  }
  /// `allowed`: by how much it may be wrong about each statistic.
  Model model(Eigen::Index count, double by, double allowed = 0) {
    Model made;
    made.population.draws = Eigen::MatrixXd::NullaryExpr(count, 1, [&] { return normal_(random_); });
    made.population.whole = stacks(count, by);
    made.standard = std::make_unique<Standard>(made.population, Part::whole, std::vector<Eigen::Index>{},
                                               Eigen::VectorXd::Constant(statistics, allowed));
    made.correlation = std::make_unique<Correlation>(made.standard->own());
    return made;
  }
  Eigen::VectorXd stack(double by) { return stacks(1, by).row(0).transpose(); }

 private:
  std::mt19937 random_{11};
  std::normal_distribution<double> normal_;
};

// A model that is known from few stacks loses against one that is known from many, also where it is right:
// its scatter is known worse. What the ratio is for stacks of both says which it is.
TEST(Rivals, TheStacksOfBothSayWhatTheRatioMeans) {
  MadeUp made;
  constexpr double by = 3;
  const Model few = made.model(60, by, 1), many = made.model(240, 0);
  const Rivals rivals(few, many);
  constexpr int times = 500;
  int ratio_right = 0, odds_right = 0;
  for (int k = 0; k < times; ++k) {
    const Eigen::VectorXd of_few = made.stack(by), of_many = made.stack(0);
    ratio_right += (rivals.ratio(of_few) > 0) + (rivals.ratio(of_many) < 0);
    odds_right += (rivals.odds(of_few) > 0) + (rivals.odds(of_many) < 0);
  }
  EXPECT_GT(odds_right, 0.95 * 2 * times);
  EXPECT_LT(ratio_right, 0.9 * 2 * times);
}

TEST(Rivals, AlikeOrNeither) {
  MadeUp made;
  const Model one = made.model(90, 2), same = made.model(90, 2), other = made.model(90, -2);
  EXPECT_LT(std::fabs(Rivals(one, same).odds(made.stack(2))), 2);
  // Frames of neither count for the one that is less unlike them, but not without end.
  const double odds = Rivals(one, other).odds(made.stack(20));
  EXPECT_GT(odds, 1);
  EXPECT_LT(odds, 30);
}

TEST(Rivals, TurnedRoundTheOddsAreOpposite) {
  MadeUp made;
  const Model one = made.model(90, 2), other = made.model(120, 1);
  const Eigen::VectorXd stack = made.stack(1.5);
  EXPECT_NEAR(Rivals(one, other).ratio(stack), -Rivals(other, one).ratio(stack), 1e-9);
  EXPECT_NEAR(Rivals(one, other).odds(stack), -Rivals(other, one).odds(stack), 0.3);
}

// What a full likelihood of all statistics, known from few stacks, hardly sees.
TEST(DiscriminantOdds, TellADifferenceOfAFewStatistics) {
  MadeUp made;
  constexpr double by = 1.6;
  const Model few = made.model(90, by), many = made.model(240, 0);
  constexpr int times = 200;
  int right = 0, sure = 0;
  for (int k = 0; k < times; ++k) {
    const double of_few = discriminant_odds(few, many, made.stack(by)),
                 of_many = discriminant_odds(few, many, made.stack(0));
    right += (of_few > 0) + (of_many < 0);
    sure += (of_few > 3) + (of_many < -3);
  }
  EXPECT_GT(right, 0.94 * 2 * times);
  EXPECT_GT(sure, 0.7 * 2 * times);
}

TEST(DiscriminantOdds, AreEvenWhereTheMeansDoNotDiffer) {
  MadeUp made;
  const Model one = made.model(90, 0), same = made.model(240, 0);
  for (const double far : {0.0, 2.0, 10.0, 100.0})
    for (int k = 0; k < 50; ++k) EXPECT_LT(discriminant_odds(one, same, made.stack(far)), 3) << far;
}

// An effect of the other sign, or at another place, is not on the way.
TEST(DiscriminantOdds, AreNotForWhatTheFramesDoNotShow) {
  MadeUp made;
  const Model one = made.model(90, -3), other = made.model(240, 0);
  for (int k = 0; k < 50; ++k) EXPECT_LT(discriminant_odds(one, other, made.stack(3)), 3);
}

}  // namespace
}  // namespace atomcam
