// The list of differences, on deviations made by hand.
#include "diagnosis/where.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>

namespace atomcam {
namespace {

// Of stacks without any difference, few may show one, though statistics have tails beyond a normal law's.
TEST(Where, FalseDiscoveriesAreAsRareAsTold) {
  constexpr std::size_t steady = 250, statistics = 300;
  constexpr int stacks = 240, trials = 1000;
  std::vector<StatisticDeclaration> battery(statistics);
  for (std::size_t k = 0; k < statistics; ++k) {
    battery[k].name = "light.family." + std::to_string(k);
    battery[k].unsteady = k >= steady;
  }
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::student_t_distribution<double> tailed(5);
  const auto draw = [&] {
    Eigen::VectorXd z(static_cast<Eigen::Index>(statistics));
    for (std::size_t k = 0; k < statistics; ++k)
      z(static_cast<Eigen::Index>(k)) = k < steady ? normal(random) : tailed(random);
    return z;
  };
  Eigen::MatrixXd own(stacks, static_cast<Eigen::Index>(statistics));
  for (int n = 0; n < stacks; ++n) own.row(n) = draw().transpose();
  constexpr double level = 0.05;
  int found = 0;
  for (int n = 0; n < trials; ++n) {
    const Eigen::VectorXd z = draw();
    const auto list = ranked_differences(battery, z, z, z, own);
    found += std::any_of(list.begin(), list.end(), [](const Difference& one) { return one.q < level; });
  }
  EXPECT_LT(found, level * trials + 5 * std::sqrt(level * trials));
  // What is seen nowhere in the stacks' own is a difference, of a steady statistic sooner.
  const auto q_of = [&](std::size_t k, double size) {
    Eigen::VectorXd z = draw().cwiseMax(-1).cwiseMin(1);
    z(static_cast<Eigen::Index>(k)) = size;
    return ranked_differences(battery, z, z, z, own).front().q;
  };
  EXPECT_LT(q_of(3, 5.5), 0.01);
  EXPECT_GT(q_of(steady + 3, 5.5), 0.01);
  EXPECT_LT(q_of(steady + 3, 20), 1e-4);
  // Nor is it one where the model may be wrong by so much.
  Eigen::VectorXd z = draw().cwiseMax(-1).cwiseMin(1);
  z(3) = 5.5;
  Eigen::VectorXd tolerated = z;
  tolerated(3) = 3;
  const Difference first = ranked_differences(battery, z, tolerated, z, own).front();
  EXPECT_EQ(first.z, 5.5);
  EXPECT_GT(first.q, 0.05);
}

}  // namespace
}  // namespace atomcam
