#include "calibration/maximise.hpp"

#include <gtest/gtest.h>

namespace atomcam {
namespace {

/// A chain: each value is known by itself and against its neighbour; the last one is in all.
Likelihood chain(const Eigen::VectorXd& at) {
  const Eigen::Index n = at.size();
  Likelihood out;
  out.information.setZero(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    out.information(k, k) = 3;
    if (k + 2 < n) out.information(k, k + 1) = out.information(k + 1, k) = -1;
    if (k + 1 < n) out.information(k, n - 1) = out.information(n - 1, k) = 0.02;
  }
  const Eigen::VectorXd from = at - Eigen::VectorXd::LinSpaced(n, -1, 2);
  out.gradient = out.information * from;
  out.minus_log = 0.5 * from.dot(out.gradient);
  return out;
}

// Few parameters and many: the latter by their entries that are not zero.
TEST(Maximise, FindsTheMaximumAndItsCovariance) {
  for (const Eigen::Index n : {6, 600}) {
    const MaximumLikelihood best = maximise(
        Eigen::VectorXd::Zero(n), [](const Eigen::VectorXd& at, bool) { return chain(at); }, 1e-12);
    EXPECT_TRUE(best.converged);
    EXPECT_LT((best.values - Eigen::VectorXd::LinSpaced(n, -1, 2)).cwiseAbs().maxCoeff(), 1e-6) << n;
    const Eigen::MatrixXd inverse = chain(best.values).information.inverse();
    const std::vector<Eigen::Index> some = {0, 3, n - 1};
    const Eigen::MatrixXd covariance = best.covariance(some);
    for (std::size_t a = 0; a < some.size(); ++a)
      for (std::size_t b = 0; b < some.size(); ++b)
        EXPECT_NEAR(covariance(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)),
                    inverse(some[a], some[b]), 1e-9)
            << n;
    if (n < 100) {
      EXPECT_LT((best.covariance() - inverse).cwiseAbs().maxCoeff(), 1e-9);
    }
  }
}

}  // namespace
}  // namespace atomcam
