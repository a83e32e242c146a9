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

}  // namespace
}  // namespace atomcam
