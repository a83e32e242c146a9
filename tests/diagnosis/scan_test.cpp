#include "diagnosis/scan.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

// Statistics of made-up effects, compressed and with unit noise as those of real ones.
constexpr Eigen::Index statistics = 300, few = 8;

Uncertain strength() {
  Uncertain one;
  one.name = "strength";
  one.lowest = 0;
  one.highest = 1;
  return one;
}

class MadeUp {
 public:
  /// `response(strength, statistic)` and `scatter(strength, statistic)`, as compressed z.
  template <class Response, class Scatter>
  MadeUp(int stacks, const Response& response, const Scatter& scatter) {
    scan_.open = {strength()};
    scan_.draws.resize(stacks, 1);
    for (ScanView& view : scan_.view) view.values.resize(stacks, statistics);
    for (Eigen::Index n = 0; n < stacks; ++n) {
      const double s = (static_cast<double>(n) + 0.5) / stacks;
      scan_.draws(n, 0) = s;
      const Eigen::VectorXd seen = stack(s, response, scatter);
      for (ScanView& view : scan_.view) view.values.row(n) = seen.transpose();
    }
    for (ScanView& view : scan_.view)
      view.emulator = std::make_unique<Emulator>(scan_.open, scan_.draws, view.values);
  }

  template <class Response, class Scatter>
  Eigen::VectorXd stack(double s, const Response& response, const Scatter& scatter) {
    Eigen::VectorXd y(statistics);
    for (Eigen::Index i = 0; i < statistics; ++i)
      y(i) = response(s, i) + std::hypot(1, scatter(s, i)) * normal_(random_);
    return y;
  }
  const ScanView& matched(const Eigen::VectorXd& real) {
    match({&scan_, 1}, Correlation(Eigen::MatrixXd::Zero(1, statistics)), {real, real}, 1);
    return scan_.best();
  }
  const Emulator& emulator() const { return *scan_.view[0].emulator; }

 private:
  std::mt19937 random_{7};
  std::normal_distribution<double> normal_;
  Scan scan_;
};

const auto nothing = [](double, Eigen::Index) { return 0.0; };

TEST(Emulator, KnowsHowStacksScatterAboutIt) {
  const auto scatter = [](double s, Eigen::Index i) { return i < few ? 8 * s : 0; };
  const MadeUp made(30, nothing, scatter);
  const Eigen::VectorXd strong = made.emulator().variance(Eigen::VectorXd::Constant(1, 0.9));
  const Eigen::VectorXd weak = made.emulator().variance(Eigen::VectorXd::Constant(1, 0.05));
  EXPECT_GT(strong.head(few).mean(), 15);  // 52, of some ten stacks
  EXPECT_LT(strong.head(few).mean(), 150);
  EXPECT_LT(strong.tail(statistics - few).mean(), 0.4);
  EXPECT_LT(weak.head(few).mean(), 4);
}

// Nearly all of its range it changes everything: what the emulator does not know there must not hide what it
// does near the lower end.
TEST(Scan, FindsAWeakEffectOfAWideRange) {
  const auto response = [](double s, Eigen::Index i) {
    const double z = (i % 2 ? 1 : -1) * (i < few ? 4 : 0.02) * std::exp(9 * (s - 0.2));
    return 2 * std::asinh(z / 2);
  };
  MadeUp made(24, response, nothing);
  const ScanView& seen = made.matched(made.stack(0.2, response, nothing));
  EXPECT_GT(seen.log_likelihood, 10);
  EXPECT_NEAR(seen.best(0), 0.2, 0.1);
}

TEST(Scan, FindsWhatComesOutDifferentlyEveryTime) {
  const auto scatter = [](double s, Eigen::Index i) { return i < 2 * few ? 10 * s : 0; };
  MadeUp made(30, nothing, scatter);
  EXPECT_GT(made.matched(made.stack(0.5, nothing, scatter)).log_likelihood, 30);
}

TEST(Scan, FindsNothingWhereThereIsNothing) {
  const auto response = [](double s, Eigen::Index i) { return i < few ? 12 * s : 0; };
  const auto scatter = [](double s, Eigen::Index i) { return i > statistics - few ? 10 * s : 0; };
  MadeUp made(30, response, scatter);
  for (int k = 0; k < 20; ++k) EXPECT_LT(made.matched(made.stack(0, nothing, nothing)).log_likelihood, 8);
}

// Sizes that spread make up for a strength: the place of usual sizes is kept beside the likeliest.
TEST(Scan, KeepsThePlaceWhereSizesSpreadAsUsual) {
  constexpr int stacks = 40;
  Scan scan;
  scan.open = {strength(), strength()};
  scan.open[1].name = "effects.made_up.spread";
  scan.open[1].usual = 0.2;
  std::mt19937 random{3};
  std::normal_distribution<double> normal;
  const auto stack = [&](double s, double spread) {
    Eigen::VectorXd y(statistics);
    for (Eigen::Index i = 0; i < statistics; ++i)
      y(i) = (i < few ? 12 * s * (1 + spread * spread) : 0) + normal(random);
    return y;
  };
  scan.draws.resize(stacks, 2);
  for (ScanView& view : scan.view) view.values.resize(stacks, statistics);
  std::uniform_real_distribution<double> uniform;
  for (Eigen::Index n = 0; n < stacks; ++n) {
    scan.draws.row(n) << uniform(random), uniform(random);
    for (ScanView& view : scan.view)
      view.values.row(n) = stack(scan.draws(n, 0), scan.draws(n, 1)).transpose();
  }
  const Eigen::VectorXd real = stack(0.6, 0.2);
  match({&scan, 1}, Correlation(Eigen::MatrixXd::Zero(1, statistics)), {real, real}, 1);
  for (const ScanView& view : scan.view) {
    ASSERT_EQ(view.usual_sizes.size(), 2);
    EXPECT_EQ(view.usual_sizes(1), 0.2);
    EXPECT_NEAR(view.usual_sizes(0), 0.6, 0.1);
    EXPECT_GE(view.log_likelihood, 0);
  }
}

// On top of two effects that are known, the one that makes what they leave.
TEST(Scan, AnEffectOnTopOfOthersIsFoundByWhatTheyLeave) {
  constexpr int stacks = 30;
  const std::vector<std::string> names = {"row_noise", "hot_pixels", "vignetting", "blinking"};
  std::mt19937 random{9};
  std::normal_distribution<double> normal;
  const auto stack = [&](const std::vector<double>& strengths) {
    Eigen::VectorXd z(statistics);
    for (Eigen::Index i = 0; i < statistics; ++i) {
      const auto at = static_cast<std::size_t>(i / few);
      z(i) = normal(random) + (at < strengths.size() ? 25 * strengths[at] : 0);
    }
    return z;
  };
  const auto population = [&](Eigen::Index count, const std::vector<double>& strengths) {
    Population made;
    made.draws = Eigen::MatrixXd::NullaryExpr(count, 1, [&] { return normal(random); });
    made.whole.resize(count, statistics);
    for (Eigen::Index n = 0; n < count; ++n) made.whole.row(n) = stack(strengths).transpose();
    return made;
  };
  const Standard standard(population(200, {}), Part::whole, {}, Eigen::VectorXd::Zero(statistics));
  std::vector<Scan> scans(names.size());
  for (std::size_t k = 0; k < names.size(); ++k) {
    Scan& scan = scans[k];
    scan.effect = find_effect(names[k]);
    scan.open = {strength()};
    scan.draws.resize(stacks, 1);
    for (ScanView& view : scan.view) view.values.resize(stacks, statistics);
    for (Eigen::Index n = 0; n < stacks; ++n) {
      scan.draws(n, 0) = (static_cast<double>(n) + 0.5) / stacks;
      std::vector<double> strengths(names.size());
      strengths[k] = scan.draws(n, 0);
      const ScanViews seen = views_of(standard, stack(strengths));
      for (std::size_t v = 0; v < scan_views; ++v) scan.view[v].values.row(n) = seen[v].transpose();
    }
  }
  const ScanViews real = views_of(standard, stack({0.6, 0.5, 0.4}));
  match(scans, Correlation(Eigen::MatrixXd::Zero(1, statistics)), real, 1);
  Model pair;
  pair.effects = {"hot_pixels", "row_noise"};
  pair.population = population(60, {0.6, 0.5});
  const std::vector<AddedMatch> added = match_added(scans, pair, standard, real, 2);
  ASSERT_EQ(added.size(), 2);
  EXPECT_EQ(names[added[0].scan], "vignetting");
  EXPECT_NEAR(added[0].best(0), 0.4, 0.1);
  EXPECT_GT(added[0].gain, 30);
  EXPECT_LT(added[1].gain, 12);  // nothing is made a second effect of
}

}  // namespace
}  // namespace atomcam
