#include "diagnosis/model.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

Eigen::VectorXd row_of(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Lab Model::fitted_lab() const {
  Lab fitted = lab;
  for (std::size_t k = 0; k < open.size(); ++k) {
    const double c = estimate.size() ? estimate(static_cast<Eigen::Index>(k)) : open[k].centre;
    open[k].apply(fitted, std::clamp(c, open[k].lowest, open[k].highest));
  }
  fitted.place_sites();
  return fitted;
}

void judge(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first,
           const Eigen::MatrixXd& directions, const std::function<void(int)>& progress) {
  model.population = simulate_population(model.lab, model.open, stacks, plan, first, nullptr, progress);
  model.standard = std::make_unique<Standard>(model.population, Part::whole);
  model.test = std::make_unique<OmnibusTest>(*model.standard, directions);
  const Eigen::VectorXd statistics = row_of(real.whole);
  model.z = model.standard->judge(statistics);
  model.estimate = model.standard->estimate(statistics);
  model.error = model.standard->estimate_error();
  model.p_value = model.test->p_value(model.z);
  model.gap = gap_of(model.z);
  std::vector<double> gaps;
  for (Eigen::Index n = 0; n < model.standard->own().rows(); ++n)
    gaps.push_back(gap_of(model.standard->own().row(n).transpose()));
  model.floor = median(gaps);
  const Correlation correlation(model.standard->own());
  const auto solver = correlation.matrix.ldlt();
  const Eigen::VectorXd y = compressed(model.z);
  model.log_likelihood = -0.5 * y.dot(solver.solve(y)) -
                         0.5 * solver.vectorD().array().max(1e-12).log().sum() -
                         (model.standard->deviation().array() > 0)
                             .select(model.standard->deviation().array().max(1e-12).log(), 0.0)
                             .sum();
}

void recalibrate(Model& model, const RealStack& real, const StackPlan& plan, std::uint64_t first) {
  constexpr int stacks = 2;
  Lab lab = model.lab;
  for (const Uncertain& one : model.open) one.apply(lab, one.centre);
  lab.place_sites();
  std::vector<std::unique_ptr<Calibration>> found(stacks);
  parallel_for(stacks, plan.threads, 1, [&](int n) {
    const auto light = simulate_stack(lab, plan, first + static_cast<std::uint64_t>(n), true);
    const auto darks = simulate_stack(lab, plan, first + static_cast<std::uint64_t>(n), false);
    CalibrationInput input;
    input.notes = *real.notes;
    input.frames = light.get();
    if (plan.dark_frames > 0) input.darks = darks.get();
    input.like = real.calibration;
    try {
      found[static_cast<std::size_t>(n)] = std::make_unique<Calibration>(calibrate(input));
    } catch (const Error&) {
      // A stack that cannot be calibrated says nothing.
    }
  });
  for (auto k = Eigen::Index{0}; k < model.first_effect_parameter; ++k) {
    Uncertain& one = model.open[static_cast<std::size_t>(k)];
    double sum = 0, count = 0;
    for (const auto& calibration : found)
      if (calibration) sum += one.offset(*real.calibration, *calibration), count += 1;
    if (count == 0) continue;
    one.centre += sum / count;
    one.lowest = one.centre - 5 * one.width;
    one.highest = one.centre + 5 * one.width;
  }
}

void fit_and_judge(Model& model, const RealStack& real, int rounds, int stacks, const StackPlan& plan,
                   std::uint64_t first, const std::function<void(int)>& progress) {
  const Eigen::VectorXd statistics = row_of(real.values->whole);
  const int each = std::max(40, static_cast<int>(model.open.size()) + 20);
  // An effect that makes a point-spread function per site leaves no time for many optical systems.
  const bool one_system =
      std::find(model.effects.begin(), model.effects.end(), "field_tilt_defocus") != model.effects.end();
  if (one_system)
    for (Uncertain& one : model.open)
      if (one.shared) one.width = 0;
  for (int round = 0; round < rounds; ++round) {
    const std::uint64_t number = first + static_cast<std::uint64_t>(round) * 10000;
    recalibrate(model, real, plan, number + 5000);
    model.population = simulate_population(model.lab, model.open, each, plan, number, nullptr, progress);
    const Standard standard(model.population, Part::whole);
    const Eigen::VectorXd estimate = standard.estimate(statistics);
    bool settled = true;
    for (std::size_t k = 0; k < model.open.size(); ++k) {
      Uncertain& one = model.open[k];
      const auto at = static_cast<Eigen::Index>(k);
      const bool of_effect = at >= model.first_effect_parameter;
      if (one.width <= 0) continue;
      // Far steps are not linear: at most some widths at a time.
      const double most = (of_effect ? 3.0 : 4.0) * one.width;
      double moved = one.centre + std::clamp(estimate(at) - one.centre, -most, most);
      if (of_effect && std::fabs(estimate(at) - one.centre) > one.width) settled = false;
      if (one.cycle > 0)
        moved -= one.cycle * std::floor((moved - one.lowest) / one.cycle);
      else if (of_effect)
        moved = std::clamp(moved, one.lowest, one.highest);
      one.centre = moved;
      if (!of_effect) one.lowest = moved - 5 * one.width, one.highest = moved + 5 * one.width;
      if (of_effect && round >= 1)
        one.width = std::clamp(1.5 * standard.estimate_error()(at), 0.4 * one.width, one.width);
    }
    if (settled && round >= 1) break;
  }
  recalibrate(model, real, plan, first + 800000);
  judge(model, *real.values, stacks, plan, first + 900000, {}, progress);
}

}  // namespace atomcam
