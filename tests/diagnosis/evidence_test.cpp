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

}  // namespace
}  // namespace atomcam
