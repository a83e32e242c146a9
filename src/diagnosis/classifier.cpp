#include "diagnosis/classifier.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace atomcam {
namespace {

constexpr double ridge = 3;      // in frames: a coefficient of 1 per deviation costs as much as 1.5 of them
constexpr int newton_steps = 8;  // the logarithm of the odds is bounded by the ridge: few are enough
constexpr double farthest = 6;   // deviations; a feature beyond tells no more
constexpr double least_width = 1e-9;

/// Coefficients of the logarithm of the odds, the constant last. `weight` of each frame.
Eigen::VectorXd regression(const Eigen::MatrixXd& x, const Eigen::VectorXd& y,
                           const Eigen::VectorXd& weight) {
  const Eigen::Index d = x.cols();
  Eigen::VectorXd coefficients = Eigen::VectorXd::Zero(d);
  for (int step = 0; step < newton_steps; ++step) {
    const Eigen::ArrayXd p = 1 / (1 + (-(x * coefficients).array()).exp());
    Eigen::VectorXd gradient = x.transpose() * (weight.array() * (y.array() - p)).matrix();
    const Eigen::VectorXd curvature = (weight.array() * p * (1 - p)).matrix();
    Eigen::MatrixXd hessian = x.transpose() * curvature.asDiagonal() * x;
    gradient.head(d - 1) -= ridge * coefficients.head(d - 1);
    hessian.diagonal().head(d - 1).array() += ridge;
    hessian(d - 1, d - 1) += 1e-6;
    Eigen::VectorXd move = hessian.ldlt().solve(gradient);
    // A step too far leaves the logistic curve's bend behind.
    const double longest = (x * move).cwiseAbs().maxCoeff();
    if (longest > 4) move *= 4 / longest;
    coefficients += move;
  }
  return coefficients;
}

}  // namespace

double area_under_curve(std::vector<double> high, std::vector<double> low) {
  if (high.empty() || low.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(low.begin(), low.end());
  double sum = 0;
  for (const double score : high) {
    const auto [from, to] = std::equal_range(low.begin(), low.end(), score);
    sum += static_cast<double>(from - low.begin()) + 0.5 * static_cast<double>(to - from);
  }
  return sum / (static_cast<double>(high.size()) * static_cast<double>(low.size()));
}

TwoSampleTest two_sample_test(const LabelledFrames& high, const std::vector<const LabelledFrames*>& low) {
  std::vector<const LabelledFrames*> kinds = {&high};
  kinds.insert(kinds.end(), low.begin(), low.end());
  const Eigen::Index d = high.features.cols();
  std::vector<double> areas;
  const std::set<int> folds(high.fold.begin(), high.fold.end());
  for (const int fold : folds) {
    struct Row {
      const LabelledFrames* kind;
      Eigen::Index row;
    };
    std::vector<Row> learn, test;
    for (const LabelledFrames* kind : kinds)
      for (std::size_t n = 0; n < kind->fold.size(); ++n)
        (kind->fold[n] == fold ? test : learn).push_back({kind, static_cast<Eigen::Index>(n)});
    const auto gather = [&](const std::vector<Row>& rows) {
      Eigen::MatrixXd x(static_cast<Eigen::Index>(rows.size()), d + 1);
      for (std::size_t n = 0; n < rows.size(); ++n)
        x.row(static_cast<Eigen::Index>(n)).head(d) = rows[n].kind->features.row(rows[n].row);
      x.col(d).setOnes();
      return x;
    };
    Eigen::MatrixXd x = gather(learn), held = gather(test);
    Eigen::VectorXd y(x.rows());
    for (std::size_t n = 0; n < learn.size(); ++n)
      y(static_cast<Eigen::Index>(n)) = learn[n].kind == &high ? 1 : 0;
    const double number_high = y.sum(), number_low = static_cast<double>(y.size()) - number_high;
    if (number_high < 2 || number_low < 2) continue;
    for (Eigen::Index k = 0; k < d; ++k) {
      const double mean = (x.col(k).array() * (1 - y.array())).sum() / number_low;
      const double width =
          std::sqrt((((x.col(k).array() - mean).square()) * (1 - y.array())).sum() / number_low);
      for (Eigen::MatrixXd* one : {&x, &held})
        one->col(k) =
            width > least_width
                ? Eigen::VectorXd(((one->col(k).array() - mean) / width).max(-farthest).min(farthest))
                : Eigen::VectorXd(Eigen::VectorXd::Zero(one->rows()));
    }
    const Eigen::VectorXd weight =
        (0.5 * y.array() / number_high + 0.5 * (1 - y.array()) / number_low) * (2 * number_high);
    const Eigen::VectorXd score = held * regression(x, y, weight);
    std::vector<double> of_high, of_low;
    for (std::size_t n = 0; n < test.size(); ++n)
      (test[n].kind == &high ? of_high : of_low).push_back(score(static_cast<Eigen::Index>(n)));
    const double area = area_under_curve(std::move(of_high), std::move(of_low));
    if (std::isfinite(area)) areas.push_back(area);
  }
  TwoSampleTest result;
  if (areas.size() < 2) {
    result.auc = result.error = std::numeric_limits<double>::quiet_NaN();
    return result;
  }
  const auto count = static_cast<double>(areas.size());
  double sum = 0, squares = 0;
  for (const double area : areas) sum += area;
  result.auc = sum / count;
  for (const double area : areas) squares += (area - result.auc) * (area - result.auc);
  result.error = std::sqrt(squares / (count - 1) / count);
  return result;
}

}  // namespace atomcam
