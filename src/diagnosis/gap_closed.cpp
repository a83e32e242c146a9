#include "diagnosis/gap_closed.hpp"

#include <algorithm>
#include <set>

namespace atomcam {
namespace {

/// Held-out frames, judged by the plain model and by that with the effects, in common units.
class HeldOut {
 public:
  HeldOut(const Model& found, const Model& plain, const BatteryValues& real,
          const std::vector<StatisticDeclaration>& battery)
      : battery_(battery),
        before_(plain.population, Part::held_out),
        after_(found.population, Part::held_out, effects_of(found),
               found.explains.empty() ? Eigen::VectorXd() : found.standard->discrepancy(), effects_reach),
        units_(in_larger_units(after_, before_)) {
    const Eigen::VectorXd statistics = as_vector(real.part[1]);
    const Eigen::VectorXd values =
        fitted_to_first_part(found, real).tail(std::ssize(found.open) - found.first_effect_parameter);
    z_before_ = before_.judge(statistics).cwiseProduct(in_larger_units(before_, after_));
    z_after_ = after_.judge(statistics, values).cwiseProduct(units_);
  }

  struct Closing {
    double before = 0, after = 0, floor = 0, closed = 0, low = 0, high = 0;
  };
  Closing closing(const std::vector<std::string>& observables) const {
    const Eigen::VectorXd mask = only_of(observables, battery_);
    const Floor floor(after_, units_.cwiseProduct(mask));
    Closing one;
    one.before = gap_of(z_before_.cwiseProduct(mask));
    one.after = gap_of(z_after_.cwiseProduct(mask));
    one.floor = floor.at(0.5);
    const auto closed = [&](double from) {
      if (one.before <= from) return one.after <= from ? 1.0 : 0.0;
      return std::clamp(1 - (one.after - from) / (one.before - from), -1.0, 1.0);
    };
    one.closed = closed(one.floor);
    const double low = closed(floor.at(0.05)), high = closed(floor.at(0.95));
    one.low = std::min({low, one.closed, high});
    one.high = std::max({low, one.closed, high});
    return one;
  }

 private:
  static std::vector<Eigen::Index> effects_of(const Model& found) {
    std::vector<Eigen::Index> list;
    for (Eigen::Index k = found.first_effect_parameter; k < std::ssize(found.open); ++k) list.push_back(k);
    return list;
  }

  const std::vector<StatisticDeclaration>& battery_;
  Standard before_, after_;
  Eigen::VectorXd units_, z_before_, z_after_;
};

}  // namespace

Eigen::VectorXd only_of(const std::vector<std::string>& observables,
                        const std::vector<StatisticDeclaration>& battery) {
  Eigen::VectorXd mask(std::ssize(battery));
  for (std::size_t k = 0; k < battery.size(); ++k)
    mask(static_cast<Eigen::Index>(k)) =
        observables.empty() ||
        std::find(observables.begin(), observables.end(), battery[k].observable) != observables.end();
  return mask;
}

Eigen::VectorXd in_larger_units(const Standard& model, const Standard& other) {
  const auto a = model.deviation().array(), b = other.deviation().array();
  return (a > 0 && b > 0).select(a / a.max(b).max(1e-300), 0.0);
}

double closed_by(const Model& model, const Model& plain, const std::vector<StatisticDeclaration>& battery) {
  const Eigen::VectorXd mask = only_of(model.explains, battery);
  const Eigen::VectorXd units = in_larger_units(*model.standard, *plain.standard).cwiseProduct(mask);
  const double before =
      gap_of(plain.z.cwiseProduct(in_larger_units(*plain.standard, *model.standard)).cwiseProduct(mask));
  const double after = gap_of(model.z.cwiseProduct(units));
  const double floor = Floor(*model.standard, units).at(0.5);
  return before > floor ? 1 - std::max(0.0, after - floor) / (before - floor) : 0;
}

Eigen::VectorXd fitted_to_first_part(const Model& model, const BatteryValues& real) {
  constexpr double straight = 3;  // widths of the draws: farther out the statistics are not known
  Eigen::VectorXd value =
      model.estimator(Part::fitting).drawn_out(as_vector(real.part[0]), model.first_effect_parameter).value;
  // Half of the frames may say nothing about a parameter; what moves an estimate out then throws it far off.
  for (Eigen::Index k = model.first_effect_parameter; k < value.size(); ++k) {
    const Uncertain& one = model.open[static_cast<std::size_t>(k)];
    value(k) = std::clamp(value(k), std::max(one.lowest, one.centre - straight * one.width),
                          std::min(one.highest, one.centre + straight * one.width));
  }
  return value;
}

GapClosed gap_closed(const Model& found, const Model& plain, const BatteryValues& real,
                     const std::vector<StatisticDeclaration>& battery) {
  const HeldOut held_out(found, plain, real, battery);
  const HeldOut::Closing all = held_out.closing({});
  GapClosed gap;
  gap.before = all.before;
  gap.after = all.after;
  gap.floor = all.floor;
  gap.closed = all.closed;
  gap.closed_low = all.low;
  gap.closed_high = all.high;
  std::set<std::string> observables;
  for (const StatisticDeclaration& one : battery) observables.insert(one.observable);
  for (const std::string& name : observables) {
    const HeldOut::Closing one = held_out.closing({name});
    gap.by_observable.push_back({name, one.before, one.after, one.floor, one.closed});
  }
  std::sort(gap.by_observable.begin(), gap.by_observable.end(),
            [](const ObservableGap& a, const ObservableGap& b) { return a.before > b.before; });
  if (!found.explains.empty()) {
    const HeldOut::Closing part = held_out.closing(found.explains);
    gap.explains = found.explains;
    gap.part_closed = part.closed;
    gap.part_closed_low = part.low;
    gap.part_closed_high = part.high;
  }
  return gap;
}

GapClosed gap_left(const Model& plain, const BatteryValues& real) {
  const Standard standard(plain.population, Part::held_out);
  GapClosed gap;
  gap.before = gap.after = gap_of(standard.judge(as_vector(real.part[1])));
  gap.floor = Floor(standard).at(0.5);
  return gap;
}

}  // namespace atomcam
