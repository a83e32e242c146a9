#include "diagnosis/gap_closed.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace atomcam {
namespace {

/// Half of the frames may hardly know a parameter of the effects: what they say counts beside the draws,
/// about what all frames say. Alone it may be anywhere. `values`, `error`: of the effects' parameters, not
/// drawn to the middle.
Eigen::VectorXd beside_draws(const Model& model, Eigen::VectorXd values, const Eigen::VectorXd& error) {
  constexpr double straight = 3;  // widths of the draws: farther out the statistics are not known
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    const Uncertain& one = model.open[static_cast<std::size_t>(model.first_effect_parameter + k)];
    const double told = one.width > 0 ? 1 / (1 + std::pow(error(k) / one.width, 2)) : 0;
    const double off =
        std::clamp(told * (values(k) - one.centre), -straight * one.width, straight * one.width);
    values(k) = one.bounded(one.centre + off);
  }
  return values;
}

/// Over all frames; before, after and floor in these units.
double closed_in(const Eigen::VectorXd& units_before, const Eigen::VectorXd& units_after, const Model& model,
                 const Model& plain) {
  const double before = gap_of(plain.z.cwiseProduct(units_before));
  const double after = gap_of(model.z.cwiseProduct(units_after));
  const double floor = Floor(model.standard->own(), units_after).at(0.5);
  return before > floor ? 1 - std::max(0.0, after - floor) / (before - floor) : 0;
}

/// Directions in which a model's own stacks scatter, a row each: `own`, by the root of how many there are.
Eigen::MatrixXd directions_of(const Eigen::MatrixXd& own) {
  return own / std::sqrt(static_cast<double>(std::max<Eigen::Index>(1, own.rows())));
}
/// How they go together, with noise of unit deviation in each.
Eigen::LLT<Eigen::MatrixXd> scatter_in(const Eigen::MatrixXd& directions) {
  Eigen::MatrixXd gram = directions * directions.transpose();
  gram.diagonal().array() += 1;
  return gram.llt();
}

/// Of deviations with and without what is common, each time the smaller: rare events are far off together in
/// a few stacks, by no fixed ratio, and what they lead to expect elsewhere may be wrong.
Eigen::MatrixXd smaller_of(const Eigen::MatrixXd& with, const Eigen::MatrixXd& without) {
  return (without.array().abs() < with.array().abs()).select(without, with);
}

/// What is left of deviations where all is taken off that the model's own stacks have together with others
/// of their deviations (the mean of a normal law, given the frames, of so many directions and noise of unit
/// deviation). `own`: of the model's own stacks, a row each, in the same units.
Eigen::VectorXd without_common_scatter(const Eigen::VectorXd& z, const Eigen::MatrixXd& own) {
  const Eigen::MatrixXd directions = directions_of(own);
  return smaller_of(z, z - directions.transpose() * scatter_in(directions).solve(directions * z));
}

/// Likewise of each of a model's own stacks, a row each, less what it has together with the others (the
/// residuals of leaving one out, from the inverse of all).
Eigen::MatrixXd each_without_common_scatter(const Eigen::MatrixXd& own) {
  const Eigen::MatrixXd inverse =
      scatter_in(directions_of(own)).solve(Eigen::MatrixXd::Identity(own.rows(), own.rows()));
  return smaller_of(own, inverse.diagonal().cwiseInverse().asDiagonal() * (inverse * own));
}

/// By what a model's deviations are multiplied to be in units of the plain model's; 0 where one has none.
Eigen::VectorXd in_plain_units(const Standard& model, const Standard& plain) {
  const auto own = model.deviation().array(), before = plain.deviation().array();
  return (own > 0 && before > 0).select(own / before.max(1e-300), 0.0);
}

/// No farther than the plain model's own stacks from it; or than most of this model's own from each other,
/// which may scatter farther in no common direction, too: not much, or hardly anything of the gap.
bool differs_as_own_stacks(const Model& model, const Model& plain, const Eigen::VectorXd& mask) {
  constexpr double usual = 0.99, most = 0.9;  // part of own stacks
  constexpr double farthest = 2;              // times as far as the plain model's
  constexpr double hardly_any = 0.01;         // of the gap
  const Eigen::VectorXd units = in_plain_units(*model.standard, *plain.standard).cwiseProduct(mask);
  const Eigen::MatrixXd stacks = model.standard->own() * units.asDiagonal();
  const double left = gap_of(without_common_scatter(model.z.cwiseProduct(units), stacks));
  const double as_plain = Floor(plain.standard->own(), mask).at(usual);
  const double far = std::max(farthest * as_plain,
                              hardly_any * gap_of(plain.z.cwiseProduct((units.array() > 0).select(mask, 0))));
  return left < as_plain || (left < far && left < Floor(each_without_common_scatter(stacks)).at(most));
}

/// By that stack of the model's own which comes nearest to the frames, in the plain model's units.
double closed_by_nearest(const Model& model, const Model& plain, const Eigen::VectorXd& mask) {
  const Eigen::VectorXd units = in_plain_units(*model.standard, *plain.standard).cwiseProduct(mask);
  double left = std::numeric_limits<double>::infinity();
  for (const auto& stack : model.standard->own().rowwise())
    left = std::min(left, gap_of((model.z - stack.transpose()).cwiseProduct(units)));
  const double gap = gap_of(plain.z.cwiseProduct(mask));
  const double floor = Floor(plain.standard->own(), mask).at(0.5);
  return gap > floor ? 1 - std::max(0.0, left - 2 * floor) / (gap - floor) : 0;  // both of them scatter
}

/// What is closed, by no more than the model's own stacks can look like.
double as_own_stacks_may(double closed, const Model& model, const Model& plain, const Eigen::VectorXd& mask) {
  return differs_as_own_stacks(model, plain, mask) ? closed
                                                   : std::min(closed, closed_by_nearest(model, plain, mask));
}

/// Closed over all frames, whether each model counts in its own units, and whether the gap stands out in
/// units of the larger deviation, too.
struct ClosedByAll {
  double closed = 0;
  bool in_own_units = false, stands_out = false;
};
ClosedByAll closed_by_all(const Model& model, const Model& plain, const Eigen::VectorXd& mask) {
  constexpr double stands_out = 3;  // times the plain model's own
  const Eigen::VectorXd units = in_larger_units(*plain.standard, *model.standard).cwiseProduct(mask);
  const double closed =
      closed_in(units, in_larger_units(*model.standard, *plain.standard).cwiseProduct(mask), model, plain);
  const bool seen =
      gap_of(plain.z.cwiseProduct(units)) > stands_out * Floor(plain.standard->own(), units).at(0.5);
  if (closed > least_to_pass || !much_likelier(model, plain)) return {closed, false, seen};
  return {closed_in(mask, mask, model, plain), true, seen};
}

constexpr double shown = 0.95;  // part of own stacks that have less than a gap that shows

/// What the plain model leaves of held-out frames; all else is as if nothing were found.
GapClosed left_by(const Standard& plain, const Eigen::VectorXd& z) {
  const Floor floor(plain.own());
  GapClosed gap;
  gap.before = gap.after = gap_of(z);
  gap.floor = floor.at(0.5);
  gap.shows = gap.before > floor.at(shown);
  return gap;
}

/// Held-out frames, judged by the plain model and by that with the effects.
class HeldOut {
 public:
  HeldOut(const Model& found, const Model& plain, const BatteryValues& real,
          const std::vector<StatisticDeclaration>& battery)
      : battery_(battery),
        before_(plain.population, Part::held_out),
        after_(found.population, Part::held_out, effects_of(found),
               found.explains.empty() ? Eigen::VectorXd() : found.standard->discrepancy(), effects_reach) {
    const Standard estimator = found.estimator(Part::fitting);
    own_ = as_fitted(found, estimator);
    const Eigen::VectorXd statistics = as_vector(real.part[1]);
    const Eigen::VectorXd values = fitted_to_first_part(found, estimator, real)
                                       .tail(std::ssize(found.open) - found.first_effect_parameter);
    z_before_ = before_.judge(statistics);
    shows_ = left_by(before_, z_before_).shows;
    z_after_ = after_.judge(statistics, values);
    const Eigen::VectorXd in_common = z_before_.cwiseProduct(in_larger_units(before_, after_));
    const Eigen::VectorXd units = in_larger_units(after_, before_);
    const double left = gap_of(in_common);
    if (closed_by_all(found, plain, only_of(found.explains, battery)).in_own_units ||
        left < hidden * gap_of(z_before_) || (shows_ && left < Floor(own_, units).at(shown))) {
      grant_scatter();
      return;
    }
    z_before_ = in_common;
    z_after_ = z_after_.cwiseProduct(units);
    own_ = own_ * units.asDiagonal();
  }

  bool shows() const { return shows_; }

  struct Closing {
    double before = 0, after = 0, floor = 0, closed = 0, low = 0, high = 0;
  };
  Closing closing(const std::vector<std::string>& observables) const {
    const Eigen::VectorXd mask = only_of(observables, battery_);
    const Floor floor(own_, mask);
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

  /// What comes out differently in every stack would hide the gap in units of the larger deviation: in the
  /// plain model's units, what the own stacks have together being taken off.
  void grant_scatter() {
    const Eigen::VectorXd units = in_plain_units(after_, before_);
    const Eigen::MatrixXd stacks = own_ * units.asDiagonal();
    z_before_ = z_before_.cwiseProduct((units.array() > 0).cast<double>().matrix());
    z_after_ = without_common_scatter(z_after_.cwiseProduct(units), stacks);
    own_ = each_without_common_scatter(stacks);
  }

  /// The model's own stacks, judged as the real one is: by what half of the frames says of the effects, not
  /// by what they are. The errors of that are those of its fits to own stacks.
  Eigen::MatrixXd as_fitted(const Model& found, const Standard& estimator) const {
    const Eigen::MatrixXd& statistics = values_of(found.population, Part::held_out);
    const Eigen::MatrixXd& misses = estimator.misses();
    const auto from = found.first_effect_parameter, effects = std::ssize(found.open) - from;
    const Eigen::VectorXd error =
        estimator.drawn_out(statistics.row(0).transpose(), from).error.tail(effects);
    const Eigen::ArrayXd further =
        error.array() / estimator.estimate_error().tail(effects).array().max(1e-300);
    Eigen::MatrixXd own = after_.own();
    for (Eigen::Index n = 0; n < own.rows(); ++n) {
      const Eigen::VectorXd drawn = found.population.draws.row(n).tail(effects).transpose();
      const Eigen::VectorXd miss = misses.row(n % misses.rows()).tail(effects).transpose().array() * further;
      const Eigen::VectorXd seen = statistics.row(n).transpose();
      own.row(n) += (after_.judge(seen, beside_draws(found, drawn + miss, error)) - after_.judge(seen, drawn))
                        .transpose();
    }
    return own;
  }

  static constexpr double hidden = 0.5;  // less of the gap is left in units of the larger deviation

  const std::vector<StatisticDeclaration>& battery_;
  Standard before_, after_;
  Eigen::MatrixXd own_;                 // of the model with effects, as z_after
  Eigen::VectorXd z_before_, z_after_;  // deviations in common units
  bool shows_ = false;
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
  return closed_by(model, plain, battery, model.explains);
}

double closed_by(const Model& model, const Model& plain, const std::vector<StatisticDeclaration>& battery,
                 const std::vector<std::string>& observables) {
  const Eigen::VectorXd mask = only_of(observables, battery);
  const ClosedByAll all = closed_by_all(model, plain, mask);
  if (all.stands_out && !all.in_own_units) return all.closed;  // no scatter hides it
  return as_own_stacks_may(all.closed, model, plain, mask);
}

double closed_in_own_units(const Model& model, const Model& plain,
                           const std::vector<StatisticDeclaration>& battery) {
  const Eigen::VectorXd mask = only_of(model.explains, battery);
  return as_own_stacks_may(closed_in(mask, mask, model, plain), model, plain, mask);
}

bool much_likelier(const Model& model, const Model& plain) {
  constexpr double least_evidence = 24;   // logarithm, beyond the plain model's
  constexpr double least_share = 0.15;    // of what the frames are less likely than the plain model's own
  constexpr double least_likely = 0.001;  // p-value: no effect of the catalogue is right to all digits
  const double evidence = model.log_likelihood - plain.log_likelihood;
  const double missing = plain.usual_log_likelihood - plain.log_likelihood;
  return model.p_value >= least_likely && evidence >= std::max(least_evidence, least_share * missing);
}

bool differs_as_own_stacks(const Model& model, const Model& plain,
                           const std::vector<StatisticDeclaration>& battery) {
  return differs_as_own_stacks(model, plain, only_of(model.explains, battery));
}

Eigen::VectorXd fitted_to_first_part(const Model& model, const BatteryValues& real) {
  return fitted_to_first_part(model, model.estimator(Part::fitting), real);
}

Eigen::VectorXd fitted_to_first_part(const Model& model, const Standard& estimator,
                                     const BatteryValues& real) {
  Standard::Estimate half = estimator.drawn_out(as_vector(real.part[0]), model.first_effect_parameter);
  const auto effects = std::ssize(model.open) - model.first_effect_parameter;
  half.value.tail(effects) = beside_draws(model, half.value.tail(effects), half.error.tail(effects));
  return half.value;
}

GapClosed gap_closed(const Model& found, const Model& plain, const BatteryValues& real,
                     const std::vector<StatisticDeclaration>& battery) {
  const HeldOut held_out(found, plain, real, battery);
  const HeldOut::Closing all = held_out.closing({});
  GapClosed gap;
  gap.shows = held_out.shows();
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
  return left_by(standard, standard.judge(as_vector(real.part[1])));
}

}  // namespace atomcam
