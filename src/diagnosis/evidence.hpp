#pragma once
// How far a stack is from a model, in one number, and with which probability the model gives as much.

#include <Eigen/Dense>
#include <array>
#include <optional>
#include <vector>

#include "diagnosis/standard.hpp"

namespace atomcam {

/// Grows like z, then like its logarithm: one huge statistic must not outvote all others.
Eigen::VectorXd compressed(const Eigen::VectorXd& z);
Eigen::MatrixXd compressed_rows(const Eigen::MatrixXd& z);

/// A number that may be by chance as large as `chance`, less what chance makes of it: 0 if not beyond.
double beyond_chance(double value, double chance);

/// Mean of the squares of the 12 largest |z|: the gap.
double gap_of(const Eigen::VectorXd& z);

/// The gap of a model's own stacks, from small to large.
class Floor {
 public:
  /// `own`: deviations of the model's own stacks, a row each. `units`: by which every statistic's z is
  /// multiplied first; empty: by nothing.
  explicit Floor(const Eigen::MatrixXd& own, const Eigen::VectorXd& units = {});
  double at(double quantile) const;

 private:
  std::vector<double> sorted_;
};

/// Correlations of a model's compressed statistics, shrunk towards independence.
class Correlation {
 public:
  /// `own`: deviations of the model's own stacks, a row each.
  explicit Correlation(const Eigen::MatrixXd& own);
  /// Every column x weighed by the inverse C^-1 of the correlations: C^-1 x.
  Eigen::MatrixXd weighed(const Eigen::MatrixXd& columns) const;
  /// x' C^-1 x of every column.
  Eigen::VectorXd squares(const Eigen::MatrixXd& columns) const;
  double log_determinant() const { return log_determinant_; }

 private:
  // A multiple of unity and the few directions in which stacks scatter together: far fewer numbers than a
  // matrix of all pairs of statistics (Woodbury).
  double alone_ = 1;
  Eigen::MatrixXd together_;  // [direction, statistic]
  double log_determinant_ = 0;
};

/// What correlations are without the stacks of each fold (every Standard::folds-th), to judge these by.
/// `own`: deviations of the model's own stacks, a row each.
std::vector<Correlation> correlations_without_each_fold(const Eigen::MatrixXd& own);

/// p-value below which there is a gap. Of stacks without one, one in 200 may be called so; a null of some
/// hundred stacks does not know its own tail to better than this margin.
inline constexpr double gap_level = 0.004;

/// Does a stack differ from the model? Three views, each with its null from the model's own stacks: the
/// largest |z|, and the largest and the gap of the steady statistics alone, of which less is by chance; one
/// p-value.
class OmnibusTest {
 public:
  /// What the views' tails are known by: these stacks, or also those of the plain model in other labs.
  /// Statistics that are far off now and then count less there, as their fourth moments say.
  enum class Tails { of_these, of_all_labs };
  /// `own`: residuals of stacks that do not differ, a row each. `unsteady`: per statistic, as declared;
  /// empty: none is.
  OmnibusTest(const Eigen::MatrixXd& own, std::vector<bool> unsteady, Tails tails = Tails::of_these);
  double p_value(const Eigen::VectorXd& z) const;

 private:
  static constexpr int views = 3;
  using Views = std::array<double, views>;
  Views look(const Eigen::VectorXd& z, const Eigen::VectorXd& weights) const;
  double smallest(const Views& seen) const;

  Tails tails_;
  std::vector<bool> unsteady_;
  Eigen::VectorXd weights_;
  std::vector<NullDistribution> nulls_;
  std::optional<NullDistribution> combined_;
};

}  // namespace atomcam
