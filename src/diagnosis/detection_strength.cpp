#include "diagnosis/detection_strength.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "base/error.hpp"
#include "base/quantile.hpp"

namespace atomcam {
namespace {

constexpr int null_stacks = 100, stacks = 12, stacks_without = 48;  // of each twin at each strength
// Standard deviations at which a known signal is seen in nine of ten at gap_level: normal quantiles of 99.6 %
// and 90 %.
constexpr double known_signal = 2.6521 + 1.2816;
constexpr double clear = 7;  // squared distance that is more than chance

}  // namespace

DetectionGround::DetectionGround(const Lab& lab, const Notes& notes, std::size_t frames,
                                 std::size_t dark_frames, int threads)
    : lab_(lab), notes_(notes) {
  plan_.frames = frames;
  plan_.dark_frames = dark_frames;
  plan_.split = split_of(frames);
  plan_.threads = threads;
  none_ = judge_twice(lab_, "detection/none", stacks_without);
}

std::array<DetectionGround::Judged, 2> DetectionGround::judge_twice(const Lab& lab, std::string_view stream,
                                                                    int count) const {
  StackPlan twin = plan_;
  twin.seed = plan_.seed + 1;
  return {judge(lab, stream, count, plan_), judge(lab, stream, count, twin)};
}

DetectionGround::Judged DetectionGround::judge(const Lab& lab, std::string_view stream, int count,
                                               StackPlan plan) const {
  // The same chance at every strength.
  const std::uint64_t number = numbers_of("detection/calibrated");
  const auto light = simulate_stack(lab, plan, number, true);
  const auto darks = plan.dark_frames.count() > 0 ? simulate_stack(lab, plan, number, false) : nullptr;
  CalibrationInput input;
  input.notes = notes_;
  input.frames = light.get();
  input.darks = darks.get();
  const Calibration calibration = calibrate(input);
  plan.model = calibration.model;
  const BatteryValues values = measure(plan.model, *light, darks.get(), plan.split);
  Judged judged{plain_model({&values, &calibration, &notes_}, null_stacks, plan), {}};
  const Population population = simulate_population(lab, {}, count, plan, numbers_of(stream));
  const Standard& plain = *judged.plain.standard;
  judged.residuals.resize(population.whole.rows(), population.whole.cols());
  for (Eigen::Index n = 0; n < population.whole.rows(); ++n)
    judged.residuals.row(n) =
        plain.tolerated(plain.judge_recalibrated(population.whole.row(n).transpose())).transpose();
  return judged;
}

DetectionGround::Seen DetectionGround::look(const EffectDeclaration& effect, ParameterValues values,
                                            double strength) const {
  Lab lab = lab_;
  values.front() = strength;
  lab.effects[effect.name] = values;
  std::optional<std::array<Judged, 2>> twins;
  try {
    twins = judge_twice(lab, fmt::format("detection/{}/{}", effect.name, strength), stacks);
  } catch (const Error&) {
    return {-1e3, 0};  // so strong that its stacks are refused
  }
  std::vector<double> p_values;
  for (const Judged& one : *twins)
    for (const auto& stack : one.residuals.rowwise())
      p_values.push_back(one.plain.test->p_value(stack.transpose()));
  return {std::log(std::max(1e-300, quantile(p_values, 0.9))), squared_distance(*twins)};
}

Eigen::VectorXd DetectionGround::Judged::middle() const {
  return compressed_rows(residuals).colwise().mean().transpose();
}

/// What the plain models of either twin are off by is not common to both, and makes no distance. Correlations
/// of hundreds of statistics are known from fewer stacks: how far stacks that they were not learned from
/// scatter along the effect's way is what it has to stand out of.
double DetectionGround::squared_distance(const std::array<Judged, 2>& twins) const {
  const Eigen::VectorXd ways[] = {twins[0].middle() - none_[0].middle(),
                                  twins[1].middle() - none_[1].middle()};
  const Eigen::VectorXd way = 0.5 * (ways[0] + ways[1]);
  double squared = 0, scatter = 0;
  for (const Judged& one : twins) {
    const Eigen::MatrixXd own = compressed_rows(tolerated_own(one.plain));
    const std::vector<Correlation> without_fold = correlations_without_each_fold(one.plain.standard->own());
    double of_own = 0;
    for (int fold = 0; fold < Standard::folds; ++fold) {
      const Eigen::VectorXd filter = without_fold[static_cast<std::size_t>(fold)].weighed(way).col(0);
      const double norm = way.dot(filter);
      for (Eigen::Index n = fold; n < own.rows(); n += Standard::folds)
        of_own += std::pow(own.row(n).dot(filter), 2) / norm;
    }
    scatter += of_own / static_cast<double>(own.rows()) / 2;
    squared += ways[0].dot(one.plain.correlation->weighed(ways[1]).col(0)) / 2;
  }
  return squared / scatter;
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
    for (int step = 0; step < 2; ++step) {
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
