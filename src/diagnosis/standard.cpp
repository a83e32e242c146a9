#include "diagnosis/standard.hpp"

#include <algorithm>
#include <cmath>

#include "base/quantile.hpp"

namespace atomcam {
namespace {

constexpr double winsor = 5;         // residuals count at most this many deviations in the estimates
constexpr double prior_widths = 10;  // of a parameter, in widths of its draws
constexpr double largest_z = 1e4;
constexpr double ordinary = 4;  // deviations that a model's own stacks have now and then
// Counts of events enter by asinh: of one where stacks have none a bit more than 2.5 deviations, as much as
// some hundreds of them can say; of ten nearly 9.
constexpr double still = 0.35;
constexpr double far_reach = 20;  // widths
constexpr double least_response = 0.2;
// Logarithm of the ratio of two spreads: where few stacks have anything, that of all and that of those
// without a fold may be worlds apart, and count in the unit of all.
constexpr double another_unit = 0.5;

std::vector<double> finite_column(const Eigen::MatrixXd& matrix, Eigen::Index column) {
  std::vector<double> values;
  for (Eigen::Index n = 0; n < matrix.rows(); ++n)
    if (std::isfinite(matrix(n, column))) values.push_back(matrix(n, column));
  return values;
}

}  // namespace

const Eigen::MatrixXd& values_of(const Population& population, Part part) {
  return part == Part::whole ? population.whole : population.part[part == Part::fitting ? 0 : 1];
}

Standard::Fit Standard::fit(const Eigen::MatrixXd& statistics, const Eigen::MatrixXd& draws) const {
  const Eigen::Index n = statistics.rows(), p = statistics.cols(), m = draws.cols();
  Fit fit;
  fit.middle.setZero(p);
  fit.spread.setZero(p);
  for (Eigen::Index i = 0; i < p; ++i) {
    const std::vector<double> values = finite_column(statistics, i);
    if (values.size() < 8 || values.size() < static_cast<std::size_t>(n) * 9 / 10) continue;
    fit.middle(i) = quantile(values, 0.5);
    fit.spread(i) = std::max(0.7413 * (quantile(values, 0.75) - quantile(values, 0.25)),
                             (quantile(values, 0.975) - quantile(values, 0.025)) / 4.5);
    // A statistic that the model never moves (no event of its kind) counts in its own unit.
    if (fit.spread(i) < 1e-9) fit.spread(i) = still;
    fit.spread(i) = std::max(fit.spread(i), least_spread(i, fit.middle(i)));
  }
  fit.draw_mean = draws.colwise().mean();
  fit.draw_spread = ((draws.rowwise() - fit.draw_mean.transpose()).colwise().squaredNorm() /
                     static_cast<double>(std::max<Eigen::Index>(1, n - 1)))
                        .cwiseSqrt();
  Eigen::MatrixXd z(n, p);
  for (Eigen::Index k = 0; k < n; ++k)
    z.row(k) = scaled(fit, statistics.row(k).transpose()).cwiseMax(-8).cwiseMin(8).transpose();
  Eigen::MatrixXd design(n, m + 1);
  design.col(0).setOnes();
  for (Eigen::Index j = 0; j < m; ++j)
    design.col(j + 1) = fit.draw_spread(j) > 0
                            ? Eigen::VectorXd((draws.col(j).array() - fit.draw_mean(j)) / fit.draw_spread(j))
                            : Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd normal = design.transpose() * design;
  normal.diagonal().tail(m).array() += 0.5;
  const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(m + 1, m + 1));
  Eigen::MatrixXd coefficients = inverse * (design.transpose() * z);
  for (int round = 0; round < 2; ++round) {  // outliers must not tilt the slopes
    const Eigen::MatrixXd predicted = design * coefficients;
    coefficients =
        inverse * (design.transpose() * (predicted + (z - predicted).cwiseMax(-2.5).cwiseMin(2.5)));
  }
  Eigen::MatrixXd rest = z - design * coefficients;
  for (Eigen::Index i = 0; i < p; ++i) {
    fit.middle(i) += coefficients(0, i) * fit.spread(i);
    const double noise =
        std::sqrt(rest.col(i).squaredNorm() / static_cast<double>(std::max<Eigen::Index>(1, n - m - 1)));
    // A slope that the population does not show is none: a statistic that is far off for a reason of its own
    // must not speak about parameters it knows nothing of.
    for (Eigen::Index j = 0; j < m; ++j)
      if (std::fabs(coefficients(j + 1, i)) < 3 * noise * std::sqrt(inverse(j + 1, j + 1)))
        coefficients(j + 1, i) = 0;
  }
  fit.slope = coefficients.bottomRows(m).transpose();
  // A statistic that knows of no parameter could only lend its noise, which it shares with others by as much
  // as so few stacks tell: a stack that is far off there would pull the parameters along.
  std::vector<Eigen::Index> telling;
  for (Eigen::Index i = 0; i < p; ++i)
    if ((fit.slope.row(i).array() != 0).any()) telling.push_back(i);
  fit.estimator.setZero(m, p);
  if (telling.empty()) return fit;
  const auto q = static_cast<Eigen::Index>(telling.size());
  rest = z - Eigen::VectorXd::Ones(n) * coefficients.row(0) - design.rightCols(m) * fit.slope.transpose();
  const Eigen::MatrixXd told = rest(Eigen::all, telling), slope = fit.slope(telling, Eigen::all);
  const double keep = static_cast<double>(n) / static_cast<double>(n + q);
  Eigen::MatrixXd covariance =
      told.transpose() * told * (keep / static_cast<double>(std::max<Eigen::Index>(1, n)));
  for (Eigen::Index k = 0; k < q; ++k) {
    const Eigen::Index i = telling[static_cast<std::size_t>(k)];
    covariance(k, k) = std::max(covariance(k, k) / keep, 0.05);
    if (discrepancy_.size() && fit.spread(i) > 0)
      covariance(k, k) += std::pow(std::min(largest_z, discrepancy_(i) / fit.spread(i)), 2);
  }
  // delta = (J^T C^-1 J + W^-1)^-1 J^T C^-1 z
  const Eigen::MatrixXd weighted = covariance.ldlt().solve(slope);  // C^-1 J
  Eigen::MatrixXd information = slope.transpose() * weighted;
  information.diagonal().array() += 1 / (prior_widths * prior_widths);
  const Eigen::MatrixXd estimator = information.ldlt().solve(weighted.transpose());
  fit.estimator(Eigen::all, telling) = estimator;
  return fit;
}

/// One outlier more or less, where hardly any stack has one, would be many deviations.
double Standard::least_spread(Eigen::Index statistic, double middle) const {
  const auto at = static_cast<std::size_t>(statistic);
  return at < outliers_.size() && outliers_[at] ? still * std::exp(-std::max(0.0, middle)) : 0;
}

Eigen::VectorXd Standard::scaled(const Fit& fit, const Eigen::VectorXd& statistics) const {
  Eigen::VectorXd z = Eigen::VectorXd::Zero(statistics.size());
  for (Eigen::Index i = 0; i < z.size(); ++i)
    if (fit.spread(i) > 0 && std::isfinite(statistics(i)))
      z(i) = std::clamp((statistics(i) - fit.middle(i)) / fit.spread(i), -largest_z, largest_z);
  return z;
}

Eigen::VectorXd Standard::deltas(const Fit& fit, const Eigen::VectorXd& z,
                                 const Eigen::VectorXd& known_values, double reach) const {
  Eigen::VectorXd delta = Eigen::VectorXd::Zero(fit.draw_mean.size());
  const auto put_known = [&] {
    for (std::size_t k = 0; k < known_.size(); ++k) {
      const Eigen::Index j = known_[k];
      if (known_values.size() == static_cast<Eigen::Index>(known_.size()) && fit.draw_spread(j) > 0)
        delta(j) = (known_values(static_cast<Eigen::Index>(k)) - fit.draw_mean(j)) / fit.draw_spread(j);
    }
  };
  put_known();
  for (int round = 0; round < 5; ++round) {
    const Eigen::VectorXd rest = z - fit.slope * delta;
    delta += fit.estimator * rest.cwiseMax(-winsor).cwiseMin(winsor);
    delta = delta.cwiseMax(-reach).cwiseMin(reach);
    put_known();
  }
  return delta;
}

Standard::Standard(const Population& population, Part part, std::vector<Eigen::Index> known,
                   Eigen::VectorXd discrepancy, double reach)
    : known_(std::move(known)),
      outliers_(population.outliers),
      discrepancy_(std::move(discrepancy)),
      reach_(reach) {
  const Eigen::MatrixXd& statistics = values_of(population, part);
  const Eigen::Index n = statistics.rows(), p = statistics.cols(), m = population.draws.cols();
  fit_ = fit(statistics, population.draws);
  own_.setZero(n, p);
  misses_.setZero(n, m);
  for (int fold = 0; fold < folds; ++fold) {
    std::vector<Eigen::Index> in, out;
    for (Eigen::Index k = 0; k < n; ++k) (k % folds == fold ? out : in).push_back(k);
    if (out.empty() || in.empty()) continue;
    Eigen::MatrixXd s(static_cast<Eigen::Index>(in.size()), p), d(static_cast<Eigen::Index>(in.size()), m);
    for (std::size_t k = 0; k < in.size(); ++k) {
      s.row(static_cast<Eigen::Index>(k)) = statistics.row(in[k]);
      d.row(static_cast<Eigen::Index>(k)) = population.draws.row(in[k]);
    }
    const Fit without = fit(s, d);
    for (const Eigen::Index k : out) {
      Eigen::VectorXd given(static_cast<Eigen::Index>(known_.size()));
      for (std::size_t j = 0; j < known_.size(); ++j)
        given(static_cast<Eigen::Index>(j)) = population.draws(k, known_[j]);
      const Eigen::VectorXd z = scaled(without, statistics.row(k).transpose());
      const Eigen::VectorXd delta = deltas(without, z, given, reach_);
      own_.row(k) = (z - without.slope * delta).transpose();
      for (Eigen::Index i = 0; i < p; ++i) {
        if (!std::isfinite(statistics(k, i)) || without.spread(i) <= 0 || fit_.spread(i) <= 0) {
          own_(k, i) = 0;
        } else if (const double ratio = without.spread(i) / fit_.spread(i);
                   std::fabs(std::log(ratio)) > another_unit) {
          own_(k, i) *= ratio;
        }
      }
      misses_.row(k) =
          (without.draw_mean + delta.cwiseProduct(without.draw_spread)).transpose() - population.draws.row(k);
    }
  }
  const auto root_mean_square = [n](const auto& column) {
    return std::sqrt(column.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(1, n)));
  };
  estimate_error_.resize(m);
  drawn_out_error_.resize(m);
  response_.setOnes(m);
  for (Eigen::Index j = 0; j < m; ++j) {
    const Eigen::VectorXd miss = misses_.col(j), off = population.draws.col(j).array() - fit_.draw_mean(j);
    if (const double square = off.squaredNorm(); square > 0)
      response_(j) = std::clamp(1 + miss.dot(off) / square, least_response, 1.0);
    estimate_error_(j) = root_mean_square(miss);
    // Estimate less draw, the estimate moved out: (miss + off) / response - off.
    drawn_out_error_(j) = root_mean_square((miss + (1 - response_(j)) * off) / response_(j));
  }
  // A heavy tail counts as a wide law: the deviation is at least what the outer quantiles say.
  deviation_.setZero(p);
  erratic_.assign(static_cast<std::size_t>(p), false);
  for (Eigen::Index i = 0; i < p; ++i) {
    if (!(fit_.spread(i) > 0)) continue;
    std::vector<double> sizes;
    for (Eigen::Index k = 0; k < n; ++k) sizes.push_back(std::fabs(own_(k, i)));
    // What hardly any stack moves counts in its own unit: none of some hundreds has an event, and that much
    // says of it.
    const double least = fit_.spread(i) == still ? 1 : 0.2;
    const double body = std::max(
        {1.4826 * quantile(sizes, 0.5), quantile(sizes, 0.9) / 1.645, quantile(sizes, 0.985) / 2.43, least});
    // Rare large values: the largest of all stacks counts as 4. The stack that has it is judged by the
    // others'.
    Eigen::Index at_largest = 0;
    double largest = 0, second = 0;
    for (Eigen::Index k = 0; k < n; ++k) {
      const double size = sizes[static_cast<std::size_t>(k)];
      if (size > largest) {
        second = largest;
        largest = size;
        at_largest = k;
      } else {
        second = std::max(second, size);
      }
    }
    const double unit = std::max(body, largest / 4);
    deviation_(i) = unit * fit_.spread(i);
    own_.col(i) /= unit;
    own_(at_largest, i) *= unit / std::max(body, second / 4);
    // Of a statistic that some stacks throw far out for no reason, nothing is to be concluded beyond that.
    if (n > 0 && std::fabs(own_(at_largest, i)) > 1.5 * ordinary) {
      erratic_[static_cast<std::size_t>(i)] = true;
      own_.col(i) = own_.col(i).cwiseMax(-ordinary).cwiseMin(ordinary);
    }
  }
}

Eigen::VectorXd Standard::judge(const Eigen::VectorXd& statistics,
                                const Eigen::VectorXd& known_values) const {
  return judge(statistics, known_values, reach_);
}

Eigen::VectorXd Standard::judge_recalibrated(const Eigen::VectorXd& statistics) const {
  return judge(statistics, {}, far_reach);
}

Eigen::VectorXd Standard::judge(const Eigen::VectorXd& statistics, const Eigen::VectorXd& known_values,
                                double reach) const {
  const Eigen::VectorXd z = scaled(fit_, statistics);
  Eigen::VectorXd rest = z - fit_.slope * deltas(fit_, z, known_values, reach);
  for (Eigen::Index i = 0; i < rest.size(); ++i) {
    const double limit = erratic_[static_cast<std::size_t>(i)] ? ordinary : largest_z;
    rest(i) = deviation_(i) > 0 && std::isfinite(statistics(i))
                  ? std::clamp(rest(i) * fit_.spread(i) / deviation_(i), -limit, limit)
                  : 0;
  }
  return rest;
}

Eigen::VectorXd tolerated(Eigen::VectorXd z, const Eigen::VectorXd& deviation,
                          const Eigen::VectorXd& discrepancy) {
  for (Eigen::Index i = 0; i < z.size(); ++i)
    if (deviation(i) > 0) z(i) *= deviation(i) / std::hypot(deviation(i), discrepancy(i));
  return z;
}

Eigen::VectorXd Standard::tolerated(const Eigen::VectorXd& z) const {
  return discrepancy_.size() == 0 ? z : atomcam::tolerated(z, deviation_, discrepancy_);
}

Eigen::MatrixXd Standard::slopes() const {
  Eigen::MatrixXd slopes = fit_.spread.asDiagonal() * fit_.slope;
  for (Eigen::Index j = 0; j < slopes.cols(); ++j)
    slopes.col(j) *= fit_.draw_spread(j) > 0 ? 1 / fit_.draw_spread(j) : 0;
  return slopes;
}

Eigen::VectorXd Standard::estimate(const Eigen::VectorXd& statistics) const {
  return fit_.draw_mean + deltas(fit_, scaled(fit_, statistics), {}, reach_).cwiseProduct(fit_.draw_spread);
}

Standard::Estimate Standard::drawn_out(const Eigen::VectorXd& statistics, Eigen::Index first) const {
  Estimate out{estimate(statistics), estimate_error_};
  for (Eigen::Index j = first; j < out.value.size(); ++j) {
    out.value(j) = fit_.draw_mean(j) + (out.value(j) - fit_.draw_mean(j)) / response_(j);
    out.error(j) = drawn_out_error_(j);
  }
  return out;
}

NullDistribution::NullDistribution(std::vector<double> samples, KnownTail known)
    : sorted_(std::move(samples)) {
  std::sort(sorted_.begin(), sorted_.end());
  if (sorted_.size() < 10) return;
  const std::size_t from = sorted_.size() - std::max<std::size_t>(4, sorted_.size() / 10);
  knee_ = sorted_[from];
  // The knee is one of the samples itself.
  const double beyond = static_cast<double>(sorted_.size() - from - 1);
  share_ = (beyond + 1) / static_cast<double>(sorted_.size() + 1);
  double excess = 0;
  for (std::size_t k = from; k < sorted_.size(); ++k) excess += sorted_[k] - knee_;
  // What the samples clearly contradict is not known.
  if (excess > known.mean_excess * (beyond + 3 * std::sqrt(beyond))) known.samples = 0;
  count_ = beyond + known.samples;
  excess_ = std::max(1e-9 * count_, excess + known.samples * known.mean_excess);
}

double NullDistribution::p_value(double value) const {
  if (sorted_.empty()) return 1;
  if (value > knee_)
    return std::max(1e-300, share_ * std::exp(-count_ * std::log1p((value - knee_) / excess_)));
  const auto above = sorted_.end() - std::lower_bound(sorted_.begin(), sorted_.end(), value);
  return std::min(1.0, (static_cast<double>(above) + 0.5) / (static_cast<double>(sorted_.size()) + 1));
}

}  // namespace atomcam
