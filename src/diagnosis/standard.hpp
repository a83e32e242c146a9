#pragma once
// What a model expects of the battery, and by how many standard deviations a stack differs from it, the
// model's open parameters being estimated from the stack itself: calibration inside the null, linearised.

#include <Eigen/Dense>
#include <vector>

#include "diagnosis/population.hpp"

namespace atomcam {

enum class Part { whole, fitting, held_out };

/// How far from the centre of its draws a parameter may be, in their widths: of the plain model, where
/// calibration has been there before, and of one with effects.
inline constexpr double plain_reach = 3, effects_reach = 8;

const Eigen::MatrixXd& values_of(const Population& population, Part part);

/// Residuals with a discrepancy of the model counted as scatter beside the deviation.
Eigen::VectorXd tolerated(Eigen::VectorXd z, const Eigen::VectorXd& deviation,
                          const Eigen::VectorXd& discrepancy);

/// A statistic is linear in the open parameters about their centres, with normal-like scatter that is
/// correlated between statistics: z = J delta + noise. A stack is judged by what is left when the delta that
/// fits it best (generalised least squares, statistics that do not fit being given less weight) is taken off.
class Standard {
 public:
  /// `known`: columns of the draws whose value judge() is given instead of estimating it. `discrepancy`: by
  /// how much the model may be wrong about each statistic (1 sigma, in the statistic's unit; empty: not at
  /// all). `reach`: no parameter is farther from the centre of the draws, in their widths. Calibration has
  /// seen to that for the plain model: an effect must not be taken for a calibration that is hopelessly
  /// wrong.
  Standard(const Population& population, Part part, std::vector<Eigen::Index> known = {},
           Eigen::VectorXd discrepancy = {}, double reach = plain_reach);

  /// Residuals in standard deviations, one per statistic (0 where it cannot be said). `known_values`: of the
  /// known columns, coordinates.
  Eigen::VectorXd judge(const Eigen::VectorXd& statistics, const Eigen::VectorXd& known_values = {}) const;
  /// The same for a stack whose calibration would come out elsewhere (with an effect that looks in part like
  /// a parameter of it): parameters may go as far as it takes, along straight lines.
  Eigen::VectorXd judge_recalibrated(const Eigen::VectorXd& statistics) const;
  /// The same residuals with the discrepancy counted as scatter.
  Eigen::VectorXd tolerated(const Eigen::VectorXd& z) const;
  /// Residuals of the population's own stacks, each judged by a standard made without it: stack n without
  /// those of its fold, n modulo `folds`.
  static constexpr int folds = 10;
  const Eigen::MatrixXd& own() const { return own_; }
  /// Open parameters that fit the stack best (coordinates) and the errors of such estimates.
  Eigen::VectorXd estimate(const Eigen::VectorXd& statistics) const;
  const Eigen::VectorXd& estimate_error() const { return estimate_error_; }
  /// What those errors are for the population's own stacks: estimate less draw, [stack, parameter].
  const Eigen::MatrixXd& misses() const { return misses_; }
  /// Slopes known from few stacks draw every estimate towards the middle of the draws. A calibration's
  /// parameter is drawn as it is known, and is best left there; what an effect's are drawn from is no
  /// knowledge. The same estimate and its errors, those of the parameters from `first` on moved out as far as
  /// estimates of the population's own stacks fall short of their draws.
  struct Estimate {
    Eigen::VectorXd value, error;
  };
  Estimate drawn_out(const Eigen::VectorXd& statistics, Eigen::Index first) const;
  /// How much of a draw's way from the middle an estimate goes, per parameter.
  const Eigen::VectorXd& response() const { return response_; }
  /// Standard deviation of each statistic's residual, in the statistic's unit.
  const Eigen::VectorXd& deviation() const { return deviation_; }
  /// By how much the model may be wrong about each, in its unit.
  const Eigen::VectorXd& discrepancy() const { return discrepancy_; }
  /// What the model expects with its open parameters at the draws' mean, and by how much a unit of each
  /// parameter's coordinate moves it: [statistic], [statistic, parameter].
  const Eigen::VectorXd& middle() const { return fit_.middle; }
  Eigen::MatrixXd slopes() const;

 private:
  struct Fit {
    Eigen::VectorXd middle, spread;  // of the statistics
    Eigen::VectorXd draw_mean, draw_spread;
    Eigen::MatrixXd slope;      // J: [statistic, parameter], in spreads per draw spread
    Eigen::MatrixXd estimator;  // [parameter, statistic]
  };
  Fit fit(const Eigen::MatrixXd& statistics, const Eigen::MatrixXd& draws) const;
  double least_spread(Eigen::Index statistic, double middle) const;
  Eigen::VectorXd scaled(const Fit& fit, const Eigen::VectorXd& statistics) const;
  Eigen::VectorXd deltas(const Fit& fit, const Eigen::VectorXd& z, const Eigen::VectorXd& known_values,
                         double reach) const;
  Eigen::VectorXd judge(const Eigen::VectorXd& statistics, const Eigen::VectorXd& known_values,
                        double reach) const;

  std::vector<Eigen::Index> known_;
  std::vector<bool> outliers_;
  Eigen::VectorXd discrepancy_;
  double reach_;
  Fit fit_;
  Eigen::VectorXd deviation_;
  std::vector<bool> erratic_;
  Eigen::MatrixXd own_, misses_;
  Eigen::VectorXd estimate_error_;
  Eigen::VectorXd response_;  // of an estimate to its draw: 1 if it follows
  Eigen::VectorXd drawn_out_error_;
};

/// Upper tail of a null distribution that is known by samples: their ranks, and beyond the highest tenth an
/// exponential of the excess, its scale being as uncertain as so many samples leave it (the predictive law).
class NullDistribution {
 public:
  /// What is known of the scale beforehand: the mean excess, worth so many samples beyond the highest tenth,
  /// if the samples do not have one that is larger by three of their errors.
  struct KnownTail {
    double mean_excess, samples;
  };
  explicit NullDistribution(std::vector<double> samples, KnownTail known = {});
  double p_value(double value) const;

 private:
  std::vector<double> sorted_;
  double knee_ = 0, share_ = 0.1;  // of the samples beyond the knee
  double excess_ = 1, count_ = 1;  // sum and number of what the scale is known by
};

}  // namespace atomcam
