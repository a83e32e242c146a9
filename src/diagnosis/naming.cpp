#include "diagnosis/naming.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string_view>
#include <vector>

#include "base/quantile.hpp"
#include "diagnosis/contenders.hpp"
#include "diagnosis/gap_closed.hpp"
#include "diagnosis/rivals.hpp"

namespace atomcam {
namespace {

constexpr double hardly_ever = 0.001;          // p-value of a model that nothing can be added to
constexpr double odd = 0.05;                   // p-value of frames that a model fits none too well
constexpr double least_closed_else = 0.95;     // of the gap, by an effect that frames are odd under, or two
constexpr double clear_if_odd = 4.5;           // from one that the frames are a little odd under anyway
constexpr double as_it_was = 0.8;              // what is left of one from the plain model, in its parts
constexpr double least_evidence = 4;           // log likelihood: a little scatter hides a small gap, too
constexpr double sure = 0.9, possible = 0.02;  // probabilities: of one model alone, of one beside it
constexpr double hardly_any = 0.04;            // part of a model's own stacks
constexpr double shows = 0.9;                  // part of the plain model's stacks that have less
constexpr double shows_clearly = 0.995;        // nearly all
constexpr double large = 30;                   // deviations: beyond, one is as good as another

/// Far more than its own stacks have, and not just the last digits of a law, by any of these stacks: no
/// effect of the catalogue is right to all digits. Stacks that scatter widely are not odd with it, but
/// somebody else made it.
bool leaves_much(const GapClosed& held_out) {
  constexpr double far_more = 2, last_digits = 0.05;  // of the floor; of the gap
  return held_out.after > far_more * held_out.floor && held_out.closed_high < 1 - last_digits;
}

/// In which these effects show.
std::vector<std::string> observables_of(const std::vector<std::string>& effects) {
  std::vector<std::string> list;
  for (const std::string& name : effects)
    for (const std::string& observable : find_effect(name)->observables) list.push_back(observable);
  return list;
}

/// A few large deviations are not everything.
Eigen::VectorXd no_larger(const Eigen::VectorXd& z) {
  return z.cwiseMin(large).cwiseMax(-large);
}

/// A length that an effect repeats after is the longest that the frame holds, or may be.
bool as_long_as_may_be(const Model& model, const std::string& effect) {
  for (Eigen::Index k = model.first_effect_parameter; k < std::ssize(model.open); ++k) {
    const Uncertain& one = model.open[static_cast<std::size_t>(k)];
    if (one.name == "effects." + effect + ".period_px" && model.estimate(k) + model.error(k) >= one.most)
      return true;
  }
  return false;
}

/// How much there is in deviations.
double shown_in(const Eigen::VectorXd& z) {
  return no_larger(z).squaredNorm();
}

}  // namespace

std::string most_missed(const Model& model, const std::vector<StatisticDeclaration>& battery) {
  std::map<std::string, double> gaps;
  for (const StatisticDeclaration& one : battery)
    if (!gaps.contains(one.observable))
      gaps[one.observable] = gap_of(model.z.cwiseProduct(only_of({one.observable}, battery)));
  return std::max_element(gaps.begin(), gaps.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

double clear_difference_of(const Eigen::MatrixXd& own, double least) {
  std::vector<double> largest;
  for (const auto& stack : own.rowwise()) largest.push_back(stack.cwiseAbs().maxCoeff());
  return std::max(least, median(std::move(largest)));
}

bool odd_under(const Model& model) {
  return std::min(model.p_value, model.oddest) < odd;
}

Model& likeliest(std::span<Model> models) {
  return *std::max_element(models.begin(), models.end(), [](const Model& a, const Model& b) {
    return a.log_likelihood < b.log_likelihood;
  });
}

double chance_of(const Model& model, const Model& plain) {
  if (model.oddest < reject_level) return 0;
  const Floor floor(model.standard->own());
  const double usual = floor.at(0.5), granted = floor.at(1 - reject_level) - usual;
  return std::min(1.0, granted / std::max(plain.gap - usual, granted));
}

bool closes_too_little(const GapClosed& held_out, const Model& found, const Model& plain) {
  if (!found.explains.empty()) return held_out.part_closed_high < least_part_closed;
  if (found.p_value < reject_level) return held_out.closed < least_closed_if_rejected;
  if (leaves_much(held_out)) return true;
  // Half of the frames: half of the gap.
  return odd_under(found) ? held_out.closed < least_closed_if_odd - 2 * chance_of(found, plain)
                          : held_out.closed_high < least_closed;
}

std::vector<FoundEffect> found_effects(const Named& named) {
  const Model& model = *named.model;
  std::vector<FoundEffect> list;
  for (const std::string& name : model.effects) {
    FoundEffect found;
    found.name = name;
    found.stage = stage_of(name);
    found.probability = named.probability;
    found.confusable_with = named.confusable_with;
    for (const ParameterDeclaration& p : find_effect(name)->parameters) {
      const std::string key = "effects." + name + "." + p.key;
      for (std::size_t k = 0; k < model.open.size(); ++k) {
        const Uncertain& one = model.open[k];
        if (one.name != key) continue;
        const auto at = static_cast<Eigen::Index>(k);
        const double c = one.within(model.estimate(at)), error = model.error(at);
        // An angle's interval goes on beyond the bounds, where it comes round again.
        // The smallest size that is looked for is as good as none: an interval that reaches it reaches none.
        const bool none = one.cycle == 0 && c - error <= one.lowest && one.least == one.lowest;
        const double low = none ? p.minimum : one.value(one.bounded(c - error)),
                     high = one.value(one.bounded(c + error));
        found.parameters.push_back({p.key, p.unit, one.value(c), low, high});
      }
    }
    list.push_back(std::move(found));
  }
  return list;
}

double Naming::closed_by(const Model& model) const {
  return atomcam::closed_by(model, plain_, battery_);
}

bool Naming::likelier(const Model& model) const {
  return !model.explains.empty() || model.log_likelihood >= plain_.log_likelihood + least_evidence ||
         discriminant_odds(model, plain_, as_vector(real_.whole)) >= least_evidence;
}

bool Naming::takes_nearly_all(const Model& model) const {
  return closed_by(model) >= least_closed_if_rejected && may_be(model) && not_known(model).empty() &&
         odd_where_most_was(model).empty();
}

bool Naming::may_be(const Model& model) const {
  return likelier(model) && !contradicted(model) && foreign_to(model) < 0 && wanted_more_of(model).empty() &&
         not_seen(model).empty();
}

Naming::Below Naming::below(const Model& model, const std::vector<std::string>& observables) const {
  const Eigen::VectorXd mask = only_of(observables, battery_);
  const double shown = shown_in(plain_.z.cwiseProduct(mask));
  const auto part = [&](const Eigen::MatrixXd& stacks) {
    double below = 1;
    for (const auto& z : stacks.rowwise()) below += shown_in(z.transpose().cwiseProduct(mask)) <= shown;
    return below / static_cast<double>(stacks.rows() + 1);
  };
  return {part(plain_.standard->own()), part(model.from_plain)};
}

/// What scatters widely (a brightness that drifts) may have the frames among its stacks for what these do
/// elsewhere: a drift that no frame shows is none. Of one observable alone the more must be clear. The width
/// of images is no such one: aberrations that the frames were calibrated to hide all of it, a model's stacks
/// are not calibrated each.
std::string Naming::not_seen(const Model& model) const {
  constexpr double as_without = 0.99, times_more = 6, clearly_none = 0.02;
  constexpr std::string_view calibrated = "point_spread_width";
  if (!model.explains.empty()) return "";
  const auto missing = [&](const std::vector<std::string>& observables, double few) {
    const Below below = this->below(model, observables);
    return below.with_it < few && below.without > times_more * below.with_it && below.without <= as_without;
  };
  for (const std::string& effect : model.effects) {
    const std::vector<std::string> all = observables_of({effect});
    if (missing(all, hardly_any)) return fmt::format("{} would show in {}", effect, fmt::join(all, ", "));
    for (const std::string& one : all)
      if (one != calibrated && missing({one}, clearly_none))
        return fmt::format("{} would show in {}", effect, one);
  }
  return "";
}

/// What part of the plain model's stacks goes less far than the frames the way that the model's go from them
/// in these observables; all of them if its stacks go nowhere. What is odd there some other way is not
/// theirs.
double Naming::further_along(const Model& model, const std::vector<std::string>& observables) const {
  constexpr double errors = 2;
  const Eigen::MatrixXd &with = model.from_plain, &without = plain_.standard->own();
  const double stacks = static_cast<double>(with.rows());
  const Eigen::RowVectorXd mean = with.colwise().mean();
  const Eigen::RowVectorXd chance =
      errors * ((with.rowwise() - mean).colwise().squaredNorm() / stacks / stacks).cwiseSqrt();
  const Eigen::VectorXd way =
      mean.binaryExpr(chance, &beyond_chance).transpose().cwiseProduct(only_of(observables, battery_));
  if (way.isZero()) return 1;
  const auto along = [&](const Eigen::VectorXd& z) { return way.dot(no_larger(z)); };
  const double frames = along(plain_.z);
  double less = 0;
  for (const auto& stack : without.rowwise()) less += along(stack.transpose()) < frames;
  return less / static_cast<double>(without.rows());
}

/// Fringes between sites that stand some fringes apart make each as bright as chance has it: so does whatever
/// else makes sites differ. Fringes as far apart as the frame is wide are a slope, as much else is.
std::string Naming::not_known(const Model& model) const {
  for (const std::string& effect : model.effects) {
    const std::vector<std::string>& by = find_effect(effect)->known_by;
    const double least = as_long_as_may_be(model, effect) ? shows_clearly : shows;
    if (!by.empty() && std::min(below(model, by).without, further_along(model, by)) < least)
      return fmt::format("{} is known by {}, which shows nothing", effect, fmt::join(by, ", "));
  }
  return "";
}

/// Clearly so; or a parameter is at its end, and the frames show more of the effect than its stacks do.
std::string Naming::wanted_more_of(const Model& model) const {
  if (const std::string beyond = beyond_its_law(model); !beyond.empty()) return beyond;
  const std::string at_end = beyond_its_law(model, Beyond::at_all);
  if (at_end.empty() || !model.explains.empty()) return "";
  const auto whose = std::find_if(model.effects.begin(), model.effects.end(), [&](const std::string& one) {
    return at_end.starts_with("effects." + one + ".");
  });
  return below(model, observables_of({*whose})).with_it > 1 - hardly_any ? at_end : "";
}

std::string Naming::what_is_left(const Model& model, Eigen::Index at) const {
  return fmt::format("leaves {} at {:+.1f} sigma", battery_[static_cast<std::size_t>(at)].name, model.z(at));
}

/// An effect that comes near and has another law than the frames (a telegraph for a decay) leaves some of
/// what it takes away: where the frames are a little odd under the model, there they must not be.
std::string Naming::odd_where_most_was(const Model& model) const {
  if (!odd_under(model) || !model.explains.empty()) return "";
  const std::string most = most_missed(plain_, battery_);
  const Eigen::VectorXd mask = only_of({most}, battery_);
  const auto left = [&](const Eigen::VectorXd& z) { return std::log1p(gap_of(z.cwiseProduct(mask))); };
  std::vector<double> own;
  for (const auto& stack : model.standard->own().rowwise()) own.push_back(left(stack.transpose()));
  return NullDistribution(std::move(own)).p_value(left(model.standard->tolerated(model.z))) < reject_level
             ? most
             : "";
}

/// Frames may fit a model in what its effects do not touch: other stacks scatter otherwise by chance, and its
/// calibration may go farther. How far off a few rare events are (rays that hit an atom's image) is chance.
Eigen::Index Naming::foreign_to(const Model& model) const {
  constexpr double clear = 5, beside = 0.6, as_odd = 0.5;  // of the oddest; of the frames' deviation
  Eigen::Index at = -1;
  if (!model.explains.empty()) return at;
  double oddest = std::max(clear, beside * plain_.z.cwiseAbs().maxCoeff());
  for (Eigen::Index i = 0; i < plain_.z.size(); ++i) {
    const double z = plain_.z(i), far = as_odd * std::min(std::fabs(z), large);
    if (std::fabs(z) <= oddest) continue;
    const auto reach = (model.from_plain.col(i).array() * std::copysign(1, z) > far).count();
    if (static_cast<double>(reach) >= hardly_any * static_cast<double>(model.from_plain.rows())) continue;
    oddest = std::fabs(z);
    at = i;
  }
  return at;
}

Eigen::Index Naming::left_by(const Model& model) const {
  if (model.p_value < reject_level) {
    Eigen::Index worst = 0;
    model.z.cwiseAbs().maxCoeff(&worst);
    return worst;
  }
  const Eigen::Index at = largest_as_it_was(model);
  return at >= 0 ? at : foreign_to(model);
}

std::string Naming::objection(const Model& model) const {
  if (const Eigen::Index at = left_by(model); at >= 0) {
    if (model.p_value < reject_level) return what_is_left(model, at);
    if (contradicted(model)) return what_is_left(model, at) + ", as it was";
    return fmt::format("does not touch {}", battery_[static_cast<std::size_t>(at)].name);
  }
  if (const std::string more = wanted_more_of(model); !more.empty())
    return fmt::format("the frames want more of {} than it can be", more);
  if (std::string missing = not_seen(model); !missing.empty()) return missing;
  if (!likelier(model)) return "the frames are no likelier with it";
  if (const std::string where = odd_where_most_was(model); !where.empty())
    return fmt::format("is not what {} shows", where);
  // Stacks that scatter widely are never odd: an explanation also has to take the gap away. Two effects
  // bend to much that is not theirs.
  const bool odd_here = odd_under(model), alone = model.effects.size() == 1 && !odd_here;
  const double least =
      std::max(least_to_pass, (alone ? least_closed : least_closed_else) - chance_of(model, plain_));
  double closed = closed_by(model);
  // What comes out differently every time hides a part of the gap: where the frames are much likelier with it
  // all the same, or differ from its stacks only as these do among themselves.
  if (closed <= least && !odd_here &&
      (much_likelier(model, plain_) || differs_as_own_stacks(model, plain_, battery_)))
    closed = std::max(closed, closed_in_own_units(model, plain_, battery_));
  if (closed > least) return "";
  return fmt::format("closes {:.0f} % of the gap", std::floor(100 * closed));
}

/// The frames are not odd under it, but its own stacks scatter so widely that little of the gap shows in
/// their units. It is not named; a name that passes must be likelier, or is one of several.
bool Naming::competes(const Model& model) const {
  return model.p_value >= odd && may_be(model) &&
         closed_in_own_units(model, plain_, battery_) > least_to_pass;
}

/// In an observable that the effects are to change, what is now too much where there was too little is
/// another law of theirs: how odd the frames are with it, the p-value says.
Eigen::Index Naming::largest_as_it_was(const Model& model) const {
  const double least = odd_under(model) ? clear_if_odd : clear_difference;
  const Standard &plain = *plain_.standard, &own = *model.standard;
  const Eigen::VectorXd allowed = model.with_undrawn(plain.discrepancy());
  const Eigen::ArrayXd left = tolerated(model.z, own.deviation(), allowed).array().abs();
  const Eigen::ArrayXd before = plain_.z.cwiseProduct(plain.deviation()).array(),
                       after = model.z.cwiseProduct(own.deviation()).array(),
                       theirs = only_of(observables_of(model.effects), battery_).array();
  const Eigen::Array<bool, Eigen::Dynamic, 1> counts =
      plain.deviation().array() > 0 && left > clear_difference_of(own.own(), least) &&
      after.abs() > as_it_was * before.abs() && (theirs == 0 || after * before > 0);
  Eigen::Index at = 0;
  return counts.select(left, -1).maxCoeff(&at) > 0 ? at : -1;
}

std::optional<Named> Naming::choose(std::span<Model> models) const {
  std::vector<Model*> passed, beside;
  for (Model& model : models) {
    if (passes(model))
      (not_known(model).empty() ? passed : beside).push_back(&model);
    else if (competes(model))
      beside.push_back(&model);
  }
  if (passed.empty()) return {};
  return choose_among(std::move(passed), beside);
}

/// One of those that passed; of those beside them it may not be told apart.
Named Naming::choose_among(std::vector<Model*> passed, const std::vector<Model*>& beside) const {
  // What the frames are odd under gives way to what explains them and closes as much: likelihoods take a
  // law that scatters little for a better one, as statistics that go together count nearly as if apart.
  constexpr double odder = 20;
  const std::vector<Model*> all = passed;
  std::erase_if(passed, [&](const Model* near) {
    return near->p_value < odd && std::any_of(all.begin(), all.end(), [&](const Model* model) {
             const bool explains = near->p_value < reject_level ? model->p_value >= reject_level
                                                                : model->p_value > odder * near->p_value;
             return explains && closed_by(*model) >= closed_by(*near);
           });
  });
  const auto named_from = std::ssize(passed);
  passed.insert(passed.end(), beside.begin(), beside.end());
  const std::vector<double> odds = odds_among(passed);
  const auto first =
      static_cast<std::size_t>(std::max_element(odds.begin(), odds.begin() + named_from) - odds.begin());
  double total = 0;
  for (const double one : odds) total += std::exp(one - odds[first]);
  Named named{passed[first], Verdict::explained, 1 / total, {}};
  if (named.probability >= sure) return named;
  named.verdict = Verdict::ambiguous;
  std::set<std::string> neighbours;
  for (std::size_t k = 0; k < passed.size(); ++k)
    if (k != first && std::exp(odds[k] - odds[first]) / total > possible)
      neighbours.insert(passed[k]->effects.begin(), passed[k]->effects.end());
  for (const std::string& name : named.model->effects) neighbours.erase(name);
  named.confusable_with.assign(neighbours.begin(), neighbours.end());
  return named;
}

/// Logarithms of how likely each is of those that pass, up to a constant: against the one that no other
/// beats, or that loses least.
std::vector<double> Naming::odds_among(const std::vector<Model*>& models) const {
  const Eigen::VectorXd statistics = as_vector(real_.whole);
  const auto count = static_cast<Eigen::Index>(models.size());
  Eigen::MatrixXd odds = Eigen::MatrixXd::Zero(count, count);  // [one, other]
  for (Eigen::Index i = 0; i < count; ++i)
    for (Eigen::Index j = i + 1; j < count; ++j) {
      const Rivals rivals(*models[static_cast<std::size_t>(i)], *models[static_cast<std::size_t>(j)]);
      odds(i, j) = rivals.odds(statistics);
      odds(j, i) = -odds(i, j);
    }
  Eigen::Index first = 0;
  odds.rowwise().minCoeff().maxCoeff(&first);
  std::vector<double> over_first(models.size());
  for (Eigen::Index i = 0; i < count; ++i) over_first[static_cast<std::size_t>(i)] = odds(i, first);
  return over_first;
}

std::optional<Named> Naming::nearest(std::span<Model> models) const {
  if (models.empty()) return {};
  Model& best = likeliest(models);
  if (!takes_nearly_all(best)) return {};
  if (best.p_value < hardly_ever)
    return Named{&best, Verdict::partly_explained, 0.5 + 0.5 * closed_by(best), {}};
  std::vector<Model*> hardly_odd;
  for (Model& model : models)
    if (model.p_value >= hardly_ever && takes_nearly_all(model)) hardly_odd.push_back(&model);
  return choose_among(std::move(hardly_odd), {});
}

}  // namespace atomcam
