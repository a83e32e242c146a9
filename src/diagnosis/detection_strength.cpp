#include "diagnosis/detection_strength.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/error.hpp"
#include "base/quantile.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr int null_stacks = 160, stacks = 24, calibrated_stacks = 6;  // the latter two: at each strength
// Standard deviations at which a known signal is seen in nine of ten at gap_level: normal quantiles of 99.6 %
// and 90 %.
constexpr double known_signal = 2.6521 + 1.2816;
constexpr double clear = 5;  // squared distance that is more than chance

}  // namespace

DetectionGround::DetectionGround(const Lab& lab, const Notes& notes, std::size_t frames,
                                 std::size_t dark_frames, int threads)
    : lab_(lab), notes_(notes) {
  plan_.frames = frames;
  plan_.dark_frames = dark_frames;
  plan_.split = split_of(frames);
  plan_.threads = threads;
  const std::uint64_t number = numbers_of("detection/calibrated");
  const auto light = simulate_stack(lab_, plan_, number, true);
  const auto darks = dark_frames > 0 ? simulate_stack(lab_, plan_, number, false) : nullptr;
  CalibrationInput input;
  input.notes = notes;
  input.frames = light.get();
  input.darks = darks.get();
  calibration_ = calibrate(input);
  plan_.model = calibration_.model;
  const BatteryValues values = measure(plan_.model, *light, darks.get(), plan_.split);
  const RealStack real{&values, &calibration_, &notes};
  plain_ = plain_model(real, null_stacks, plan_);
  own_offset_ = mean_offset(lab_);
  own_middle_ = plain_middle(Eigen::VectorXd::Zero(own_offset_.size()));
  none_ = halves_of(residuals(simulate_population(lab_, {}, stacks, plan_, numbers_of("detection/none")),
                              Eigen::VectorXd::Zero(own_middle_.size())));
  own_ = compressed_rows(tolerated_own(plain_));
  without_fold_ = correlations_without_each_fold(plain_.standard->own());
}

Eigen::VectorXd DetectionGround::mean_offset(const Lab& lab) const {
  const auto parameters = static_cast<Eigen::Index>(plain_.open.size());
  Eigen::MatrixXd offsets =
      Eigen::MatrixXd::Constant(parameters, calibrated_stacks, std::numeric_limits<double>::quiet_NaN());
  const std::uint64_t first = numbers_of("detection/calibrations");
  parallel_for(calibrated_stacks, plan_.threads, 1, [&](int n) {
    const auto number = first + static_cast<std::uint64_t>(n);
    const auto light = simulate_stack(lab, plan_, number, true);
    const auto darks = plan_.dark_frames.count() > 0 ? simulate_stack(lab, plan_, number, false) : nullptr;
    CalibrationInput input;
    input.notes = notes_;
    input.frames = light.get();
    input.darks = darks.get();
    input.like = &calibration_;
    try {
      const Calibration one = calibrate(input);
      for (Eigen::Index k = 0; k < parameters; ++k)
        offsets(k, n) = plain_.open[static_cast<std::size_t>(k)].offset(one, calibration_);
    } catch (const Error&) {
      // A stack that cannot be calibrated says nothing.
    }
  });
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(parameters);
  for (Eigen::Index k = 0; k < parameters; ++k) {
    double sum = 0, count = 0;
    for (const double offset : offsets.row(k))
      if (std::isfinite(offset)) sum += offset, count += 1;
    if (count > 0) mean(k) = sum / count;
  }
  return mean;
}

Eigen::VectorXd DetectionGround::plain_middle(const Eigen::VectorXd& offset) const {
  Eigen::VectorXd coordinates = offset;
  for (Eigen::Index k = 0; k < offset.size(); ++k)
    coordinates(k) += plain_.open[static_cast<std::size_t>(k)].centre;
  return simulate_population(plain_.lab_at(coordinates), {}, stacks, plan_, numbers_of("detection/plain"))
      .whole.colwise()
      .mean()
      .transpose();
}

DetectionGround::Seen DetectionGround::look(const EffectDeclaration& effect, ParameterValues values,
                                            double strength) const {
  Lab lab = lab_;
  values.front() = strength;
  lab.effects[effect.name] = values;
  const Population population = simulate_population(
      lab, {}, stacks, plan_, numbers_of(fmt::format("detection/{}/{}", effect.name, strength)));
  // What calibrating them absorbs: the plain model that they are compared with follows it. Means of a few
  // stacks each: of what may be chance is taken off, hundreds of statistics would add up to a distance.
  const double chance = 2 * std::sqrt(2.0 / stacks);
  const Eigen::VectorXd followed =
      (plain_middle(mean_offset(lab) - own_offset_) - own_middle_)
          .binaryExpr(plain_.standard->deviation(), [chance](double by, double deviation) {
            return beyond_chance(by, chance * deviation);
          });
  const Eigen::MatrixXd rest = residuals(population, followed);
  std::vector<double> p_values;
  for (const auto& stack : rest.rowwise()) p_values.push_back(plain_.test->p_value(stack.transpose()));
  Halves seen = halves_of(rest);
  for (std::size_t half = 0; half < 2; ++half) seen[half] -= none_[half];
  return {std::log(std::max(1e-300, quantile(p_values, 0.9))), squared_distance(seen)};
}

Eigen::MatrixXd DetectionGround::residuals(const Population& population,
                                           const Eigen::VectorXd& followed) const {
  Eigen::MatrixXd rest(population.whole.rows(), population.whole.cols());
  for (Eigen::Index n = 0; n < rest.rows(); ++n)
    rest.row(n) =
        plain_.standard
            ->tolerated(plain_.standard->judge_recalibrated(population.whole.row(n).transpose() - followed))
            .transpose();
  return rest;
}

DetectionGround::Halves DetectionGround::halves_of(const Eigen::MatrixXd& residuals) {
  const Eigen::MatrixXd seen = compressed_rows(residuals);
  Halves half;
  for (auto& sum : half) sum.setZero(seen.cols());
  for (Eigen::Index n = 0; n < seen.rows(); ++n)
    half[static_cast<std::size_t>(n % 2)] += seen.row(n).transpose() / (static_cast<double>(seen.rows()) / 2);
  return half;
}

/// Correlations of hundreds of statistics are known from fewer stacks: how far stacks that they were not
/// learned from scatter along the effect's way is what it has to stand out of.
double DetectionGround::squared_distance(const Halves& from_none) const {
  const Eigen::VectorXd way = 0.5 * (from_none[0] + from_none[1]);
  double scatter = 0;
  for (int fold = 0; fold < Standard::folds; ++fold) {
    const Eigen::VectorXd filter = without_fold_[static_cast<std::size_t>(fold)].weighed(way).col(0);
    const double norm = way.dot(filter);
    for (Eigen::Index n = fold; n < own_.rows(); n += Standard::folds)
      scatter += std::pow(own_.row(n).dot(filter), 2) / norm;
  }
  return from_none[0].dot(plain_.correlation->weighed(from_none[1]).col(0)) /
         (scatter / static_cast<double>(own_.rows()));
}

DetectionStrength DetectionGround::of(const EffectDeclaration& effect, ParameterValues values) const {
  const ParameterDeclaration& first = effect.parameters.front();
  const double least = std::max(first.minimum, first.default_value * 1e-4), most = first.maximum;
  const double level = std::log(gap_level);
  struct Point {
    double log_strength;
    Seen seen;
  };
  std::vector<Point> points;
  const auto at = [&](double log_strength) {
    const double strength = std::clamp(std::exp(log_strength), least, most);
    points.push_back({std::log(strength), look(effect, values, strength)});
    return points.back();
  };
  // Doubled or halved until the level lies between two strengths, then halved intervals.
  Point near = at(std::log(first.default_value)), far = near;
  const bool weaker = near.seen.log_p < level;
  while ((far.seen.log_p < level) == weaker) {
    near = far;
    if (near.log_strength == std::log(weaker ? least : most)) break;
    far = at(near.log_strength + (weaker ? -1 : 1) * std::log(2));
  }
  DetectionStrength found;
  if ((far.seen.log_p < level) == weaker) {
    found.strength = std::exp(far.log_strength);
    found.reached = weaker;
  } else {
    Point below = weaker ? far : near, above = weaker ? near : far;
    for (int step = 0; step < 3; ++step) {
      const Point middle = at(0.5 * (below.log_strength + above.log_strength));
      (middle.seen.log_p < level ? above : below) = middle;
    }
    const double part = (level - below.seen.log_p) / (above.seen.log_p - below.seen.log_p);
    found.strength = std::exp(std::lerp(below.log_strength, above.log_strength, part));
  }
  // The distance grows like a power of the strength: a line through what is clear and not far away.
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const Point& point : points) {
    if (point.seen.distance < clear || std::fabs(point.log_strength - std::log(found.strength)) > 1.5)
      continue;
    const double log_distance = std::log(point.seen.distance);
    n += 1, x += point.log_strength, y += log_distance;
    xx += point.log_strength * point.log_strength, xy += point.log_strength * log_distance;
  }
  if (n < 2 || n * xx - x * x < 1e-6) return found;
  const double slope = std::clamp((n * xy - x * y) / (n * xx - x * x), 0.7, 4.0);
  found.matched_filter = std::exp(x / n + (2 * std::log(known_signal) - y / n) / slope);
  return found;
}

}  // namespace atomcam
