#include "diagnosis/contenders.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>
#include <span>

#include "diagnosis/gap_closed.hpp"
#include "diagnosis/known_optics.hpp"
#include "diagnosis/naming.hpp"
#include "diagnosis/wider_estimate.hpp"

namespace atomcam {
namespace {

constexpr int first_rounds = 3, more_rounds = 8, most_followed = 3, judged_stacks = 90, more_looks = 3,
              optics_steps = 2;

// Once a model has come near, how many times as far another one may be after two rounds; and another start
// of the same effects, which is to be a better one, after its first.
constexpr double too_far = 3, no_better = 1.5;

constexpr double comfortable = 0.05;  // p-value: below it there may be a better place near by
constexpr double hardly_odd = 0.001;  // likewise: what has not closed the gap may do so from there,
constexpr double promising = 0.3;     // if it closes so much of it: what is not there closes next to nothing
constexpr double worthwhile = 0.9;    // of the plain model's distance: farther away is not followed up
constexpr double beyond_doubt = 30;   // of the logarithmic likelihood, behind the likeliest
constexpr double as_good = 5;         // likewise: it is learned from some tens of stacks
constexpr double other_stacks = 10;   // likewise: what it goes down by when these are others
constexpr double out_of_reach = 100;  // likewise, behind one that explains the frames
constexpr double reachable = 3;       // nothing farther away has come near in still more rounds
constexpr double closes_less = 0.05;  // of the gap: what scatters widely is not led there
constexpr double closes_more = 0.02;  // likewise: of a part no more is closed from there

/// Distance from which on a model is hopelessly behind the nearest.
double behind(double nearest) {
  return std::max(like_own, 1.4 * nearest);
}

/// Likewise, of a model that has not been followed.
double hopeless_beside(double nearest) {
  return nearest < like_own ? behind(nearest) : too_far * nearest;
}

/// Whether a model is so many times as far away as another one of the same effects, as likelihood tells it.
bool farther(double times, const Model& model, const Model& other) {
  return model.unlikeliness > other.unlikeliness + (times - 1) * other.distance;
}

class Race {
 public:
  Race(std::vector<Contender>& contenders, const FitGround& ground, const Before& before,
       const StackPlan& plan, const DiagnosisProgress& progress, Ends& ends)
      : contenders_(contenders),
        ground_(ground),
        before_(before),
        plan_(plan),
        progress_(progress),
        ends_(ends) {
    if (!contenders_.empty()) plain_ = plain_distance(ground_, plan_, contenders_.front().model.explains);
  }

  void first() {
    const auto count = static_cast<double>(contenders_.size());
    for (std::size_t k = 0; k < contenders_.size(); ++k) {
      Contender& one = contenders_[k];
      progress_(title(one.model), 0.4 * static_cast<double>(k) / count);
      const auto before = std::span(contenders_).first(k);
      const auto same = [&](const Contender& other) { return other.model.effects == one.model.effects; };
      const int look = std::any_of(before.begin(), before.end(), same) ? 1 : 2;
      go_on(one, look, "fit 0/");
      const bool hopeless =
          !one.lets_go && std::any_of(before.begin(), before.end(), [&](const Contender& other) {
            return other.model.distance < like_own &&
                   (same(other) ? farther(no_better, one.model, other.model)
                                : one.model.distance > too_far * other.model.distance);
          });
      if (!hopeless) go_on(one, first_rounds - look, "fit 1/");
    }
    keep_nearest_starts();
    for (const Contender& one : contenders_) ends_[one.model.effects] = one.model.nearest;
    if (plain_ < like_own)  // a gap in few statistics, of which the distance hardly tells: the scan does
      std::stable_sort(contenders_.begin(), contenders_.end(),
                       [](const Contender& a, const Contender& b) { return a.evidence > b.evidence; });
    // Where the simpler one is near already, the distance hardly tells: most statistics know of neither.
    const double least = before_.fewer < like_own ? before_.fewer : worthwhile * before_.fewer;
    std::erase_if(contenders_, [&](const Contender& one) { return !(one.model.distance < least); });
    // Nor of those that are as near as own stacks, which is the best.
    std::size_t followed = most_followed;
    while (followed < contenders_.size() && contenders_[followed].model.distance < like_own) ++followed;
    // What the scan has first may be on its way still.
    const auto likeliest = std::ranges::max_element(contenders_, {}, &Contender::evidence);
    if (const auto at = static_cast<std::size_t>(likeliest - contenders_.begin()); at >= followed)
      std::swap(contenders_[followed++], contenders_[at]);
    if (contenders_.size() > followed) contenders_.resize(followed);
  }

  void follow_up() {
    if (contenders_.empty()) return;
    // What is hardly nearer than the plain model explains nothing; the nearest is judged all the same.
    const double limit = plain_ < like_own ? like_own : worthwhile * plain_;
    let_go([&](const Model& model) { return model.distance > limit; });
    for (std::size_t k = 0; k < contenders_.size(); ++k) {
      const double distance = contenders_[k].model.distance, unlikeliness = contenders_[k].model.unlikeliness;
      if (distance > limit) break;
      // What is hopelessly behind is let go as soon as one of them has come near. Until then a start from
      // far away, of a strong effect, may still overtake those that end not quite so far.
      if (k > 0 && distance > hopeless_beside(contenders_.front().model.distance)) {
        contenders_.resize(k);
        break;
      }
      progress_(title(contenders_[k].model), 0.4 + 0.1 * static_cast<double>(k));
      follow(contenders_[k]);
      const bool several = contenders_[k].model.effects.size() > 1;
      if (several && contenders_[k].model.unlikeliness >= unlikeliness) try_second_start(contenders_[k]);
      ends_[contenders_[k].model.effects] = contenders_[k].model.nearest;
    }
    if (plain_ >= like_own) sort();
    const double& nearest = contenders_.front().model.distance;
    if (nearest > like_own && nearest < std::min(reachable, before_.as_many))
      go_on(contenders_.front(), more_rounds, "fit 3/");
    // Where even the nearest is far away, it is judged to say by how much, but not if one judged before has
    // said so.
    let_go([&](const Model& model) { return nearest > far_away || model.distance > behind(nearest); });
    if (nearest > behind(before_.as_many)) contenders_.clear();
  }

  /// The next start of the same effects, followed as well, where it is about as near; else null.
  Contender* second_start(const Model& nearest) {
    const auto second = second_starts_.find(nearest.effects);
    if (second == second_starts_.end() || farther(no_better, second->second.model, nearest)) return nullptr;
    if (followed_.insert(nearest.effects).second) follow(second->second);
    return &second->second;
  }

 private:
  /// Of each combination of effects the nearest start; the next one is kept aside. What could not follow the
  /// others to where it makes up for them goes first if it is about as near.
  void keep_nearest_starts() {
    std::sort(contenders_.begin(), contenders_.end(), [](const Contender& a, const Contender& b) {
      return a.model.unlikeliness < b.model.unlikeliness;
    });
    std::vector<Contender> nearest;
    for (Contender& one : contenders_) {
      const auto same = std::find_if(nearest.begin(), nearest.end(), [&](const Contender& other) {
        return other.model.effects == one.model.effects;
      });
      if (same == nearest.end()) {
        nearest.push_back(std::move(one));
      } else if (one.lets_go && !farther(no_better, one.model, same->model)) {
        std::swap(one, *same);
        second_starts_.insert_or_assign(same->model.effects, std::move(one));
      } else {
        second_starts_.try_emplace(same->model.effects, std::move(one));
      }
    }
    contenders_ = std::move(nearest);
    sort();
  }
  /// Where no round has come nearer, the start was in a valley of its own: of several effects each can make
  /// up for a little of what another gets wrong.
  void try_second_start(Contender& stuck) {
    Contender* second = second_start(stuck.model);
    if (second && second->model.unlikeliness < stuck.model.unlikeliness) std::swap(stuck, *second);
  }
  void follow(Contender& contender) {
    go_on(contender, more_rounds, "fit 2/");
    if (!contender.lets_go) return;
    contender.lets_go = false;
    for (auto* parameters : {&contender.model.open, &contender.model.nearest})
      for (Uncertain& one : *parameters) one.held = false;
    go_on(contender, first_rounds, "fit 4/");
  }
  void go_on(Contender& contender, int rounds, const std::string& step) {
    fit(contender.model, ground_, rounds, plan_, numbers_of(step + contender.name));
  }
  void sort() {
    std::sort(contenders_.begin(), contenders_.end(),
              [](const Contender& a, const Contender& b) { return a.model.distance < b.model.distance; });
  }
  /// From the farthest on, but never the nearest.
  template <class Far>
  void let_go(const Far& far) {
    while (contenders_.size() > 1 && far(contenders_.back().model)) contenders_.pop_back();
  }

  std::vector<Contender>& contenders_;
  const FitGround& ground_;
  const Before before_;
  const StackPlan& plan_;
  const DiagnosisProgress& progress_;
  Ends& ends_;
  std::map<std::vector<std::string>, Contender> second_starts_;
  std::set<std::vector<std::string>> followed_;  // whose second start was
  double plain_ = 0;                             // distance of the plain model
};

/// Whether judging has led the calibration's parameters far from where the model has them: what comes out
/// differently every time calibrates differently every time, and this stack not as others do.
bool calibrates_elsewhere(const Model& model) {
  constexpr double far = 3;  // widths
  for (Eigen::Index k = 0; k < model.first_effect_parameter; ++k) {
    const Uncertain& one = model.open[static_cast<std::size_t>(k)];
    if (std::fabs(model.estimate(k) - one.centre) > far * std::max(one.width, model.error(k))) return true;
  }
  return false;
}

/// Other effects make the frames odd: only what is closed says how good it is.
bool in_part(const Model& model) {
  return !model.explains.empty();
}

/// Whether frames tell an effect's parameter far better than it was drawn: what its draws alone make scatter
/// hides what is left of the gap. Where it is told to be outside them it need not be there.
bool drawn_too_widely(const Model& model, Eigen::Index parameter) {
  constexpr double too_wide = 4;  // errors
  const Uncertain& one = model.open[static_cast<std::size_t>(parameter)];
  return one.width > too_wide * model.error(parameter) &&
         std::fabs(model.estimate(parameter) - one.centre) < one.width;
}

/// The model about where judging it has led, its effects and what calibrations do not tell, or all of the
/// calibration as well.
Model about_estimate(const Model& model, bool calibration) {
  constexpr double farthest = 4;  // widths
  constexpr double untold = 3;    // widths: an error so large says nothing of where to go
  constexpr double narrow = 2;    // errors
  Model moved = model.unjudged();
  for (Eigen::Index k = model.first_effect_parameter; k < std::ssize(moved.open); ++k) {
    Uncertain& one = moved.open[static_cast<std::size_t>(k)];
    if (model.error(k) > untold * one.width) continue;
    const double way =
        std::clamp(model.estimate(k) - one.centre, -farthest * one.width, farthest * one.width);
    if (in_part(model) && drawn_too_widely(model, k)) one.width = narrow * model.error(k);
    one.centre = one.bounded(one.centre + way);
  }
  for (Eigen::Index k = 0; k < model.first_effect_parameter; ++k)
    if (Uncertain& one = moved.open[static_cast<std::size_t>(k)];
        !one.held && (calibration || one.calibrates_widely()))
      one.move_to(model.estimate(k));
  return moved;
}

struct Judged {
  Model model;
  double closed = 0;
};

/// The likeliest that passes; of those as good as that, the one that the frames are least odd under: what
/// looks were gone on for. Of what explains a part, the one that closes most. Which stacks each was judged by
/// is chance: it remembers the oddest.
Judged& best_of(std::vector<Judged>& looks) {
  if (in_part(looks.front().model))
    return *std::max_element(looks.begin(), looks.end(),
                             [](const Judged& a, const Judged& b) { return a.closed < b.closed; });
  const auto rank = [](const Judged& one) {
    return std::pair(one.model.p_value >= reject_level, one.model.log_likelihood);
  };
  Judged* best = &*std::max_element(looks.begin(), looks.end(),
                                    [&](const Judged& a, const Judged& b) { return rank(a) < rank(b); });
  if (best->model.p_value < comfortable) {
    // Another start may have led to where they are not odd at all, and there the others' oddness is not its
    // own.
    const double least = best->model.log_likelihood - 2 * other_stacks;
    Judged* explains = nullptr;
    for (Judged& one : looks)
      if (one.model.p_value >= comfortable && one.model.log_likelihood >= least &&
          (!explains || rank(*explains) < rank(one)))
        explains = &one;
    if (explains) {
      explains->model.oddest = explains->model.p_value;
      return *explains;
    }
  }
  const double least = best->model.log_likelihood - as_good;
  double oddest = best->model.p_value;
  for (Judged& one : looks) {
    if (one.model.log_likelihood < least) continue;
    oddest = std::min(oddest, one.model.p_value);
    if (one.model.p_value > best->model.p_value) best = &one;
  }
  best->model.oddest = oddest;
  return *best;
}

/// What has been learned of the models judged so far.
struct Standing {
  double likeliest = -1e300;    // logarithmic likelihood of those that close the gap
  double explaining = -1e300;   // and of those that explain the frames
  double unlikeliness = 1e300;  // where the likeliest of these was fitted
  void learn(const Model& model, double closed) {
    if (closed < least_to_pass) return;
    likeliest = std::max(likeliest, model.log_likelihood);
    if (model.oddest < comfortable || model.log_likelihood <= explaining) return;
    explaining = model.log_likelihood;
    unlikeliness = model.unlikeliness;
  }
  /// A fit tells likelihoods nearly as well as a look.
  bool worth_a_look(const Model& fitted, std::size_t statistics) const {
    return 0.5 * static_cast<double>(statistics) * (fitted.unlikeliness - unlikeliness) < out_of_reach;
  }
  /// What is rejected must take nearly all of the gap away to be named; what is far less likely than one that
  /// explains the frames will not be.
  bool may_be_named(const Model& model, double closed) const {
    if (closed <= least_to_pass || model.log_likelihood < explaining - out_of_reach) return false;
    if (model.p_value >= reject_level) return true;
    return model.log_likelihood > likeliest - beyond_doubt &&
           (in_part(model) || closed >= least_closed_if_rejected);
  }
};

/// A model is judged by simulating it where a fit has led, and again where that leads.
class Looks {
 public:
  Looks(const FitGround& ground, const std::vector<StatisticDeclaration>& battery,
        const std::vector<std::string>& asked, const StackPlan& plan, const Standing& standing,
        const DiagnosisProgress& progress, double progress_from)
      : ground_(ground),
        battery_(battery),
        asked_(asked),
        plan_(plan),
        standing_(standing),
        progress_(progress),
        from_(progress_from) {}

  Judged& best() { return best_of(looks_); }

  /// Near, or of a part and drawn too widely to say how much of it is explained.
  bool worth_another(const Judged& look) const {
    if (!in_part(look.model)) return look.model.distance <= reachable && near(look);
    for (Eigen::Index k = look.model.first_effect_parameter; k < std::ssize(look.model.open); ++k)
      if (drawn_too_widely(look.model, k)) return true;
    return look.closed > promising;
  }

  /// Near, and not quite there: as many stacks show the way better than the few of a fit's round.
  bool near(const Judged& look) const {
    return look.model.p_value < comfortable &&
           look.model.log_likelihood > standing_.explaining - out_of_reach &&
           (look.closed > least_to_pass || (look.closed > promising && look.model.p_value > hardly_odd) ||
            much_likelier(look.model, *ground_.plain) ||
            differs_as_own_stacks(look.model, *ground_.plain, battery_));
  }

  void look_from(Model start, const std::string& name) {
    const std::size_t first = looks_.size();
    looks_.push_back(judged(std::move(start), "/" + name, false));
    for (std::size_t more = 1; more <= more_looks && worth_another(looks_.back()); ++more) {
      const bool calibrated = calibrates_elsewhere(looks_.back().model);
      Judged next = judged(about_estimate(looks_.back().model, calibrated),
                           fmt::format(" {}/{}", looks_.size() - first, name), calibrated);
      if (!in_part(next.model) && next.model.log_likelihood < looks_.back().model.log_likelihood &&
          next.model.p_value < looks_.back().model.p_value)
        break;
      const bool no_nearer =
          in_part(next.model) ? closes_no_more(next, looks_.back()) : stuck(next, looks_.back());
      looks_.push_back(std::move(next));
      if (no_nearer) break;
    }
  }

  /// Near by all that the fit goes by, and perhaps still on the way: where optics make up for a part of it.
  void follow_optics(const std::string& name) {
    if (!standing_.may_be_named(best().model, best().closed) || left_behind()) return;
    std::swap(best(), looks_.back());
    for (int step = 0, steps = optics_steps;; ++step) {
      Model& last = looks_.back().model;
      const std::string number = fmt::format(" along {}/{}", step, name);
      const bool away = estimate_with_wider_optics(last, *ground_.real.values, judged_stacks, plan_,
                                                   numbers_of("optics" + number));
      if (!away || step == steps) break;
      Judged next = judged(about_estimate(last, true), number, true);
      if (next.model.log_likelihood < last.log_likelihood - other_stacks ||
          next.closed < looks_.back().closed - closes_less)
        break;
      // From a place that explains the frames to another one no likelier: not on the way any more.
      if (std::min(next.model.p_value, last.p_value) >= comfortable &&
          next.model.log_likelihood < last.log_likelihood + other_stacks)
        steps = step + 1;
      learn_from(next.model, last);
      looks_.push_back(std::move(next));
      if (left_behind()) break;
    }
    if (&best() != &looks_.back()) take_estimate(best().model, looks_.back().model);
  }

 private:
  /// Far less likely than one that explains the frames, and the last look came no nearer to it.
  bool left_behind() {
    if (looks_.size() < 2) return false;
    const double before = looks_[looks_.size() - 2].model.log_likelihood;
    return looks_.back().model.log_likelihood < before + other_stacks &&
           best().model.log_likelihood < standing_.explaining - beyond_doubt;
  }

  /// Of a part: what may be named goes on until its strengths stay where they are.
  static bool closes_no_more(const Judged& look, const Judged& before) {
    constexpr double stays = 2;  // errors
    const auto went = [&](Eigen::Index k) {
      const double centre = look.model.open[static_cast<std::size_t>(k)].centre;
      return std::fabs(look.model.estimate(k) - centre) > stays * look.model.error(k);
    };
    if (look.closed >= least_part_closed)
      for (Eigen::Index k = look.model.first_effect_parameter; k < std::ssize(look.model.open); ++k)
        if (went(k)) return false;
    return look.closed < before.closed + closes_more;
  }

  /// Rejected, and neither less odd than at the look before nor with less left of the gap.
  static bool stuck(const Judged& look, const Judged& before) {
    constexpr double less_odd = 2, less_left = 0.75;  // times as before
    return look.model.p_value < reject_level && look.model.p_value < less_odd * before.model.p_value &&
           1 - look.closed > less_left * (1 - before.closed);
  }

  Judged judged(Model model, const std::string& number, bool calibrated) {
    if (!calibrated) recalibrate(model, ground_.real, plan_, numbers_of("calibration" + number));
    // A point-spread function per site leaves no time for many optical systems.
    if (model.has(field_focus_effect)) leave_undrawn(model, *ground_.plain);
    judge(model, *ground_.real.values, judged_stacks, plan_, numbers_of("judge" + number), ground_.plain,
          [&](int done) {
            progress_(title(model), from_ + part_ * std::min(1.0, static_cast<double>(done) / judged_stacks));
          });
    from_ += part_;
    part_ /= 2;
    const double closed = closed_by(model, *ground_.plain, battery_, asked_);
    return {std::move(model), closed};
  }

  const FitGround& ground_;
  const std::vector<StatisticDeclaration>& battery_;
  const std::vector<std::string>& asked_;  // observables of which the gap is to be closed; none: all
  const StackPlan& plan_;
  const Standing& standing_;
  const DiagnosisProgress& progress_;
  double from_, part_ = 0.05;  // of the progress
  std::vector<Judged> looks_;
};

}  // namespace

std::string title(const Model& model) {
  return fmt::format("{}", fmt::join(model.effects, " + "));
}

std::vector<Contender> fitted_and_judged(std::vector<Contender> contenders, const FitGround& ground,
                                         const std::vector<StatisticDeclaration>& battery,
                                         const Before& before, const StackPlan& plan,
                                         const DiagnosisProgress& progress, Ends& ends) {
  Race race(contenders, ground, before, plan, progress, ends);
  race.first();
  race.follow_up();
  std::vector<Contender> looked_at;
  std::vector<double> closed;
  Standing standing;
  for (Contender& contender : contenders) {
    const std::string& name = contender.name;
    Model& model = contender.model;
    if (!standing.worth_a_look(model, battery.size())) continue;
    Looks looks(ground, battery, before.part, plan, standing, progress,
                0.7 + 0.1 * static_cast<double>(looked_at.size()));
    looks.look_from(std::move(model), name);
    // Of starts that all came near the distance hardly tells the right one.
    if (const Judged& best = looks.best(); looks.near(best))
      if (Contender* second = race.second_start(best.model))
        looks.look_from(std::move(second->model), second->name);
    looks.follow_optics(name);
    closed.push_back(looks.best().closed);
    model = std::move(looks.best().model);
    standing.learn(model, closed.back());
    looked_at.push_back(std::move(contender));
  }
  // What will not be named needs no errors.
  for (std::size_t k = 0; k < looked_at.size(); ++k)
    if (Model& model = looked_at[k].model; standing.may_be_named(model, closed[k]))
      widen(model, *ground.real.values, judged_stacks, plan, numbers_of("widen/" + looked_at[k].name));
  return looked_at;
}

}  // namespace atomcam
