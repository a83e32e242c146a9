#include "diagnosis/gap_closed.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

constexpr Eigen::Index stacks = 90, statistics = 40, moved = 10;

/// Statistics of no parameter; of a wide model ten and the next ten are moved alike, anew in every stack.
class MadeUp {
 public:
  Model model(bool wide) {
    Model made;
    made.population.draws = noise(1);
    made.population.whole = noise(statistics);
    if (wide)
      for (Eigen::Index n = 0; n < stacks; ++n)
        made.population.whole.row(n).head(2 * moved).array() += 20 * std::fabs(normal_(random_));
    made.standard = std::make_unique<Standard>(made.population, Part::whole);
    made.p_value = wide ? 0.5 : 1e-12;
    made.log_likelihood = wide ? 1000 : 0;
    return made;
  }
  /// Of frames whose first and second ten are off by so much.
  double closed(double first, double second) {
    Eigen::VectorXd real = noise(statistics).row(0).transpose();
    real.head(moved).array() += first;
    real.segment(moved, moved).array() += second;
    Model plain = model(false), wide = model(true);
    plain.z = plain.standard->judge(real);
    wide.z = wide.standard->judge(real);
    return closed_by(wide, plain, std::vector<StatisticDeclaration>(statistics));
  }
  /// Of frames whose statistics are moved in pairs, either as those of the wide model or each pair apart;
  /// `all_by`: the model's, and the frames' with it.
  double closed_by_walks(bool together, double all_by = 0) {
    const auto moved_in_pairs = [&](Eigen::Index count, double second) {
      Eigen::MatrixXd all =
          Eigen::MatrixXd::NullaryExpr(count, statistics, [&] { return all_by + normal_(random_); });
      for (Eigen::Index n = 0; n < count; ++n)
        for (Eigen::Index i = 0; i < statistics; i += 2) {
          const double by = 8 * normal_(random_);
          all(n, i) += by;
          all(n, i + 1) += second * by;
        }
      return all;
    };
    Model plain = model(false), wide = model(false);
    wide.population.whole = moved_in_pairs(stacks, 1);
    wide.standard = std::make_unique<Standard>(wide.population, Part::whole);
    wide.p_value = 0.5;
    wide.log_likelihood = 1000;
    const Eigen::VectorXd real = moved_in_pairs(1, together ? 1 : -1).row(0).transpose();
    plain.z = plain.standard->judge(real);
    wide.z = wide.standard->judge(real);
    return closed_by(wide, plain, std::vector<StatisticDeclaration>(statistics));
  }
  /// Frames in which a rare event moves ten statistics, and that are off in the last ten by `beside`. Of the
  /// model's stacks one has such an event, which moves ten others, too; and one in four has many of the rest
  /// far off that do not go together.
  bool rare_event_differs_as_own(double beside) {
    constexpr double far = 1000;
    constexpr Eigen::Index many = 400;
    Eigen::MatrixXd rare = noise(many);
    rare.row(0).head(moved).array() += far;
    rare.row(0).segment(moved, moved).array() += far / 6;
    for (Eigen::Index n = 1; n < stacks; n += 4) rare.row(n).segment(2 * moved, many - 3 * moved) *= far / 5;
    Eigen::VectorXd real = noise(many).row(0).transpose();
    real.head(moved).array() += far;
    real.tail(moved).array() += beside;
    Model plain = of_stacks(noise(many)), model = of_stacks(std::move(rare));
    plain.z = plain.standard->judge(real);
    model.z = model.standard->judge(real);
    return differs_as_own_stacks(model, plain, std::vector<StatisticDeclaration>(many));
  }
  /// How many of twenty stacks differ as own stacks from a model, of more statistics than it has stacks: each
  /// scatters so many times as far as the plain one.
  int differing_as_own(double scatter, double frames) {
    constexpr Eigen::Index many = 400;
    Model plain = of_stacks(noise(many)), model = of_stacks(scatter * noise(many));
    int count = 0;
    for (int n = 0; n < 20; ++n) {
      const Eigen::VectorXd real = frames * noise(many).row(0).transpose();
      plain.z = plain.standard->judge(real);
      model.z = model.standard->judge(real);
      count += differs_as_own_stacks(model, plain, std::vector<StatisticDeclaration>(many));
    }
    return count;
  }

 private:
  Model of_stacks(Eigen::MatrixXd all) {
    Model made;
    made.population.draws = noise(1);
    made.population.whole = std::move(all);
    made.standard = std::make_unique<Standard>(made.population, Part::whole);
    return made;
  }
  Eigen::MatrixXd noise(Eigen::Index columns) {
    return Eigen::MatrixXd::NullaryExpr(stacks, columns, [&] { return normal_(random_); });
  }
  std::mt19937 random_{5};
  std::normal_distribution<double> normal_;
};

// What comes out differently in every stack may be what the frames have; not if no stack looks like them.
TEST(GapClosed, ScatterThatGoesElsewhereClosesNothing) {
  MadeUp made;
  EXPECT_GT(made.closed(20, 20), 0.95);
  EXPECT_GT(made.closed(35, 35), 0.95);
  EXPECT_LT(made.closed(20, -20), 0.1);
}

// A walk is another one in every stack, and no other stack comes near; but all are made of the same steps.
TEST(GapClosed, ScatterInManyDirectionsClosesWhatLiesInThem) {
  MadeUp made;
  EXPECT_GT(made.closed_by_walks(true), 0.95);
  EXPECT_LT(made.closed_by_walks(false), 0.5);
}

// What scatters farther leaves more to other stacks of its own, in no common direction; yet not any amount.
TEST(GapClosed, OwnStacksDifferFromEachOtherAsFarAsTheyScatter) {
  MadeUp made;
  EXPECT_GT(made.differing_as_own(1, 1), 18);
  EXPECT_GT(made.differing_as_own(1.6, 1.6), 10);
  EXPECT_LT(made.differing_as_own(1.6, 2.4), 2);
  EXPECT_LT(made.differing_as_own(4, 4), 2);
}

// What others of its kind move as well says where else one may be far off, not that it is.
TEST(GapClosed, ARareEventNeedNotMoveAllThatOthersMove) {
  MadeUp made;
  EXPECT_TRUE(made.rare_event_differs_as_own(0));
  EXPECT_FALSE(made.rare_event_differs_as_own(400));
}

// How near single stacks come says nothing where the gap is many times what even the wide model scatters.
TEST(GapClosed, AGapThatStandsOutOfTheScatterNeedsNoStackNearBy) {
  MadeUp made;
  EXPECT_GT(made.closed_by_walks(false, 16), 0.9);
  EXPECT_LT(made.closed_by_walks(false, 4), 0.75);
}

TEST(GapClosed, AGapShowsWhereHeldOutFramesHaveMoreThanNineteenInTwentyStacks) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const auto noise = [&](Eigen::Index rows) {
    return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, statistics, [&] { return normal(random); }));
  };
  Model plain;
  plain.population.draws = Eigen::MatrixXd::Zero(stacks, 0);
  plain.population.part[1] = noise(stacks);
  constexpr int times = 400;
  const auto shown = [&](double by) {
    int count = 0;
    for (int time = 0; time < times; ++time) {
      Eigen::VectorXd half = noise(1).row(0).transpose();
      half(0) += by;
      BatteryValues real;
      real.part[1].assign(half.begin(), half.end());
      count += gap_left(plain, real).shows;
    }
    return count;
  };
  EXPECT_NEAR(shown(0), 0.05 * times, 5 * std::sqrt(0.05 * 0.95 * times));
  EXPECT_GT(shown(7), 0.95 * times);
}

// A small one of an effect that comes out differently every time: in its own stacks' units it would be none.
TEST(GapClosed, WhatShowsIsTheGapThatIsClosed) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  const auto made = [&](double scatter) {
    Model model;
    model.population.draws = Eigen::MatrixXd::NullaryExpr(stacks, 1, [&] { return normal(random); });
    for (Eigen::MatrixXd* part :
         {&model.population.whole, &model.population.part[0], &model.population.part[1]}) {
      *part = Eigen::MatrixXd::NullaryExpr(stacks, statistics, [&] { return normal(random); });
      for (Eigen::Index n = 0; n < stacks; ++n)
        part->row(n).head(moved).array() += scatter * std::fabs(normal(random));
    }
    model.open.resize(1);
    model.first_effect_parameter = 1;
    model.standard = std::make_unique<Standard>(model.population, Part::whole);
    model.z = Eigen::VectorXd::Zero(statistics);
    return model;
  };
  const Model plain = made(0), found = made(4);
  Eigen::VectorXd half =
      Eigen::VectorXd::NullaryExpr(statistics, [](Eigen::Index i) { return i % 2 ? 1.6 : -1.6; });
  half.head(moved).setConstant(2.4);
  BatteryValues real;
  real.part[0].assign(half.begin(), half.end());
  real.part[1] = real.part[0];
  const GapClosed gap = gap_closed(found, plain, real, std::vector<StatisticDeclaration>(statistics));
  EXPECT_TRUE(gap.shows);
  EXPECT_GT(gap.before, 4);
  EXPECT_GT(gap.closed, 0.9);
}

/// Root mean square by which what half of the frames says of an effect misses the truth, in widths of the
/// draws. `slope`: of each statistic, per width, in deviations of its noise.
double missed_by_half(double slope) {
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  const auto noise = [&](Eigen::Index rows, Eigen::Index columns) {
    return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); }));
  };
  Model model;
  model.effects = {"blinking"};
  model.open.resize(1);
  model.open[0].width = 1;
  model.population.draws = noise(stacks, 1);
  model.population.whole = model.population.part[0] = noise(stacks, statistics);
  model.population.part[0].colwise() += slope * model.population.draws.col(0);
  double squares = 0;
  constexpr int times = 400;
  for (int time = 0; time < times; ++time) {
    const double truth = normal(random);
    const Eigen::VectorXd half = noise(statistics, 1).array() + slope * truth;
    BatteryValues real;
    real.part[0].assign(half.begin(), half.end());
    squares += std::pow(fitted_to_first_part(model, real)(0) - truth, 2);
  }
  return std::sqrt(squares / times);
}

// An unbiased estimate from frames that hardly know an effect is anywhere: no place to judge the others at.
TEST(GapClosed, HalfOfTheFramesSaysNoMoreOfAnEffectThanItKnows) {
  EXPECT_LT(missed_by_half(0.2), 1.1);  // the middle of the draws misses by 1
  EXPECT_LT(missed_by_half(2), 0.15);   // what the frames know is theirs to say: 1 / (2 sqrt(40)) = 0.08
}

}  // namespace
}  // namespace atomcam
