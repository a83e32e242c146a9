#include "diagnosis/wider_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace atomcam {
namespace {

std::vector<Uncertain> with_wider_optics(std::vector<Uncertain> open) {
  constexpr double wider = 3;
  for (Uncertain& one : open)
    if (one.shared) one.width *= wider;
  return open;
}

/// With those that the model has already.
Population together(Population more, const Model& model) {
  more.append(model.wider.stacks() ? model.wider : model.population);
  return more;
}

/// Parameters as widely open as these draws are.
std::vector<Uncertain> as_drawn(std::vector<Uncertain> open, const Eigen::MatrixXd& draws) {
  for (std::size_t k = 0; k < open.size(); ++k) {
    const auto column = draws.col(static_cast<Eigen::Index>(k)).array();
    open[k].centre = column.mean();
    open[k].width = std::sqrt((column - open[k].centre).square().mean());
  }
  return open;
}

/// The parameters as `stacks` with wider optics have them, together with what the model has already.
struct WiderEstimate {
  Population population;
  Standard standard;
  Standard::Estimate estimate;

  WiderEstimate(const Model& model, const BatteryValues& real, int stacks, const StackPlan& plan,
                std::uint64_t first)
      : population(together(
            simulate_population(model.lab, with_wider_optics(model.open), stacks, plan, first), model)),
        standard(population, Part::whole, {}, model.standard->discrepancy(), effects_reach),
        estimate(within_draws(standard.drawn_out(as_vector(real.whole), model.first_effect_parameter),
                              as_drawn(model.open, population.draws), model.first_effect_parameter)) {}

  /// Whether the effects' errors are smaller for it.
  bool is_better(const Model& model) const {
    double gain = 0;
    for (Eigen::Index k = model.first_effect_parameter; k < estimate.error.size(); ++k)
      gain += std::log(std::max(1e-12, model.error(k)) / std::max(1e-12, estimate.error(k)));
    return gain >= 0;
  }
  void put_into(Model& model) {
    model.estimate = estimate.value;
    model.error = estimate.error;
    model.response = standard.response();
    model.wider = std::move(population);
  }
};

}  // namespace

bool estimate_with_wider_optics(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan,
                                std::uint64_t first) {
  constexpr double clear = 2;  // errors
  const auto drawn = [](const Uncertain& one) { return one.shared && one.width > 0; };
  if (std::none_of(model.open.begin(), model.open.end(), drawn)) return false;
  WiderEstimate(model, real, stacks, plan, first).put_into(model);
  for (Eigen::Index k = 0; k < std::ssize(model.open); ++k) {
    const Uncertain& one = model.open[static_cast<std::size_t>(k)];
    const bool counts = !one.held && (drawn(one) || k >= model.first_effect_parameter);
    if (counts && std::fabs(model.estimate(k) - one.centre) > clear * model.error(k)) return true;
  }
  return false;
}

void learn_from(Model& model, const Model& before) {
  model.wider = before.wider;
  model.wider.append(model.population);
}

void take_estimate(Model& model, const Model& other) {
  model.estimate = other.estimate;
  model.error = other.error;
  model.response = other.response;
  model.wider = other.wider;
}

void widen(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first) {
  constexpr double follows = 0.75, wider = 2.2, widest = 0.12;  // the last: of a parameter's range
  constexpr int times = 2;
  for (int time = 0; time < times; ++time) {
    bool narrow = false;
    for (Eigen::Index k = model.first_effect_parameter; k < model.response.size(); ++k) {
      Uncertain& one = model.open[static_cast<std::size_t>(k)];
      const double most = widest * (one.highest - one.lowest);
      if (one.width <= 0 || one.width >= most || model.response(k) > follows) continue;
      one.width = std::min(wider * one.width, most);
      narrow = true;
    }
    if (!narrow) return;
    WiderEstimate estimate(model, real, stacks, plan, first + static_cast<std::uint64_t>(time) * 10000);
    // Over wider draws statistics bend: that must not cost more than it gains.
    if (!estimate.is_better(model)) return;
    estimate.put_into(model);
  }
}

}  // namespace atomcam
