#include "diagnosis/search.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "diagnosis/gap_closed.hpp"
#include "diagnosis/known_optics.hpp"
#include "diagnosis/rivals.hpp"

namespace atomcam {
namespace {

constexpr std::string_view stripes_effect = "emi_stripes";

constexpr double second_evidence = 12;  // logarithm, for another effect on top of one
constexpr double if_left = 6;           // likewise, where the one alone leaves something
constexpr double takes_most = 0.5;      // of the gap: an effect that is likely there, though not accepted
constexpr double more_odds = 5;         // logarithm, over the likeliest of fewer effects, for one more
constexpr double law_shows = 0.05;  // part of what is odd in its observables, by the scan of a law of its own

/// The effects whose strength is as the question (estimate, error, lowest) asks.
template <class Question>
std::vector<std::string> effects_whose_strength(const Model& model, const Question& question) {
  std::vector<std::string> list;
  for (const std::string& name : model.effects) {
    const std::string key = "effects." + name + "." + find_effect(name)->parameters.front().key;
    const auto strength = std::find_if(model.open.begin(), model.open.end(),
                                       [&](const Uncertain& one) { return one.name == key; });
    const auto at = static_cast<Eigen::Index>(strength - model.open.begin());
    if (strength == model.open.end() || question(model.estimate(at), model.error(at), strength->lowest))
      list.push_back(name);
  }
  return list;
}

/// The effects whose strength is known, and more than the smallest that is looked for.
std::vector<std::string> significant(const Model& model) {
  return effects_whose_strength(model, [](double estimate, double error, double lowest) {
    return error <= 0.3 && estimate >= lowest + 0.2;
  });
}

bool all_significant(const Model& model) {
  return significant(model).size() == model.effects.size();
}

/// Every effect is there, however little is known of its strength.
bool all_there(const Model& model) {
  constexpr double errors = 5;
  const auto there = effects_whose_strength(model, [](double estimate, double error, double lowest) {
    return estimate >= lowest + errors * error;
  });
  return there.size() == model.effects.size();
}

/// Those of the list that are not among others.
std::vector<std::string> without(std::vector<std::string> list, const std::vector<std::string>& others) {
  std::erase_if(list, [&](const std::string& one) {
    return std::find(others.begin(), others.end(), one) != others.end();
  });
  return list;
}

bool share_observables(const EffectDeclaration& one, const EffectDeclaration& other) {
  return without(one.observables, other.observables).size() < one.observables.size();
}

/// Of the gap, in its own standard deviations, than a model of fewer effects.
bool leaves_much_less(const Model& model, const Model& fewer) {
  return model.gap - model.floor < 0.3 * (fewer.gap - fewer.floor);
}

/// Whether one of them has the same effects, about the same place.
bool judged_about(const Model& model, std::span<const Model> models) {
  return std::any_of(models.begin(), models.end(), [&](const Model& one) {
    if (one.effects != model.effects) return false;
    for (auto k = static_cast<std::size_t>(model.first_effect_parameter); k < model.open.size(); ++k) {
      const Uncertain &here = model.open[k], &there = one.open[k];
      const double apart = here.centre - there.centre;
      if (std::fabs(here.cycle > 0 ? std::remainder(apart, here.cycle) : apart) >
          std::max(here.width, there.width))
        return false;
    }
    return true;
  });
}

double nearest_of(std::span<const Model> models) {
  double nearest = 1e300;
  for (const Model& model : models) nearest = std::min(nearest, model.distance);
  return nearest;
}

void sort(std::vector<Scan>& scans) {
  std::sort(scans.begin(), scans.end(),
            [](const Scan& a, const Scan& b) { return a.best().log_likelihood > b.best().log_likelihood; });
}

std::optional<Found> found(const std::optional<Named>& named) {
  if (!named) return {};
  return Found{named->verdict, found_effects(*named), std::move(*named->model)};
}

}  // namespace

std::optional<Found> Search::run() {
  seen_ = views_of(*ground_.plain.standard, as_vector(ground_.real.values->whole));
  scan();
  const bool two = two_add_up();
  look_closer();
  note_scans();
  if (two)
    if (std::optional<Found> both = clear_pair()) return both;
  if (std::optional<Found> explanation = whole()) return explanation;
  return in_part();
}

/// Every effect over its whole range.
void Search::scan() {
  constexpr double begin = 0.25, end = 0.5;  // of the progress
  const Model& plain = ground_.plain;
  const StackPlan& plan = ground_.plan;
  const auto list = candidates(plain, ground_.excluded);
  const double one_scan = (end - begin) / static_cast<double>(std::max<std::size_t>(1, list.size()));
  double done = begin;
  for (const EffectDeclaration* effect : list) {
    Scan one;
    one.effect = effect;
    const int stacks = 12 + 3 * static_cast<int>(effect->parameters.size());
    explore(one, plain, stacks, plan, numbers_of("scan/" + effect->name),
            stacks_done(ground_.progress, effect->name, done, done + one_scan, stacks));
    done += one_scan;
    scans_.push_back(std::move(one));
  }
  match(scans_, *plain.correlation, seen_, plan.threads);
  sort(scans_);
}

/// Closer and closer at fewer and fewer effects.
void Search::look_closer() {
  constexpr double begin = 0.5, look = 0.0035;  // of the progress
  const Model& plain = ground_.plain;
  const StackPlan& plan = ground_.plan;
  double done = begin;
  for (const std::size_t leaders : {8u, 6u, 5u, 4u}) {
    const std::span<Scan> nearest(scans_.data(), std::min(leaders, scans_.size()));
    for (Scan& one : nearest) {
      explore(one, plain, 8, plan, numbers_of(fmt::format("look {}/{}", leaders, one.effect->name)),
              stacks_done(ground_.progress, one.effect->name, done, done + look, 8));
      done += look;
    }
    match(nearest, *plain.correlation, seen_, plan.threads);
    sort(scans_);
  }
}

void Search::note_scans() {
  for (const Scan& one : scans_) {
    Hypothesis seen;
    seen.effects = {one.effect->name};
    seen.log_evidence = one.best().log_likelihood;
    seen.share = one.best().share;
    hypotheses.push_back(std::move(seen));
  }
}

/// The effect alone, about places that lie apart.
std::vector<Contender> Search::starts_of(const Scan& scan, StartKind from, StartKind to) {
  const ScanView& view = scan.best();
  std::vector<Eigen::VectorXd> places;
  std::vector<Contender> contenders;
  const auto start_at = [&](StartKind kind, const Eigen::VectorXd& place, const char* why) {
    for (const Eigen::VectorXd& other : places)
      if (((place - other).cwiseAbs().array() <= view.width.array()).all()) return;
    places.push_back(place);
    if (from <= kind && kind <= to)
      contenders.push_back({scan.effect->name + why, with(ground_.plain, scan, place), view.log_likelihood});
  };
  start_at(StartKind::best, view.best, "");
  if (scan.effect->name == field_focus_effect) return contenders;
  // Also where the other view has it, if it speaks for the effect as well, and from the stack that really
  // came nearest: the emulator may have led elsewhere.
  const ScanView& other = scan.view[1 - scan.clearest()];
  if (other.log_likelihood > 0.8 * view.log_likelihood - 5)
    start_at(StartKind::seen, other.best, ", other view");
  Eigen::Index at = 0;
  view.miss.minCoeff(&at);
  start_at(StartKind::seen, scan.draws.row(at).transpose(), ", nearest");
  // And the effect in its usual form: far from it a valley may lead away.
  start_at(StartKind::usual, view.usual, ", usual");
  if (view.usual_sizes.size()) start_at(StartKind::usual, view.usual_sizes, ", usual sizes");
  return contenders;
}

/// Single effects that the scan speaks for, each from the places where the truth may be.
std::vector<Contender> Search::starts() {
  constexpr double clear_share = 0.2;  // of the misfit: this effect is likely there
  std::vector<Contender> contenders;
  for (std::size_t k = 0; k < std::min<std::size_t>(6, scans_.size()); ++k) {
    const Scan& scan = scans_[k];
    const ScanView& view = scan.best();
    // Beyond the first two only what the scan speaks for.
    if (k > 1 && view.log_likelihood < std::max(0.0, 0.4 * scans_[0].best().log_likelihood - 20)) break;
    const StartKind to = k >= 3                               ? StartKind::best
                         : k >= 2 || view.share < clear_share ? StartKind::seen
                                                              : StartKind::usual;
    started_[scan.effect->name] = to;
    for (Contender& one : starts_of(scan, StartKind::best, to)) contenders.push_back(std::move(one));
  }
  return contenders;
}

/// The likeliest effect takes most of the gap away and is not accepted, and was not fitted from everywhere: a
/// fit may have ended in a valley. (A bias that wanders slowly through a short stack, where the few stacks of
/// the scan had found a faster one.)
std::vector<Contender> Search::other_starts(std::span<Model> singles) {
  if (singles.empty()) return {};
  const Model& nearest = likeliest(singles);
  const StartKind before = started_[nearest.effects.front()];
  if (before == StartKind::usual || closed_by(nearest, ground_.plain, ground_.battery) < takes_most)
    return {};
  return starts_of(scan_of(nearest.effects.front()),
                   before == StartKind::best ? StartKind::seen : StartKind::usual, StartKind::usual);
}

/// One effect, two or three that explain all that is odd: more only where fewer do not.
std::optional<Found> Search::whole() {
  std::vector<Model> singles = fit_and_judge(starts(), 0.58, 0.69);
  if (const auto named = naming_.choose(singles)) return with_what_it_hides(*named);
  const auto choose_with = [&](std::vector<Contender> more, double from, double to) {
    for (Model& model : fit_and_judge(std::move(more), from, to, {.as_many = nearest_of(singles)}))
      singles.push_back(std::move(model));
    return naming_.choose(singles);
  };
  if (const auto named = choose_with(overlooked(singles), 0.69, 0.71)) return with_what_it_hides(*named);
  if (const auto named = choose_with(other_starts(singles), 0.71, 0.72)) return with_what_it_hides(*named);
  if (singles.empty()) return {};
  Pairs pairs = this->pairs(singles);
  if (const auto named = naming_.choose(pairs.both_needed)) return found(named);
  for (Model& model : fit_and_judge(std::move(pairs.needed_alone), 0.82, 0.84))
    singles.push_back(std::move(model));
  if (const auto named = naming_.choose(singles)) return found(named);
  const Model& either = likeliest(singles);
  std::erase_if(pairs.undecided,
                [&](const Model& pair) { return !likelier(pair, either) && !settles(pair, either); });
  if (const auto named = naming_.choose(pairs.undecided)) return found(named);
  std::vector<Model> more;
  if (!pairs.both_needed.empty()) more = triples(likeliest(pairs.both_needed));
  if (const auto named = naming_.choose(more)) return found(named);
  std::vector<Model> all;
  for (auto* models : {&singles, &pairs.both_needed, &more})
    for (Model& model : *models) all.push_back(std::move(model));
  return found(naming_.nearest(all));
}

/// One effect explains the frames: a strong one may leave too little of a weak one to be odd, and still
/// enough to know it by.
std::optional<Found> Search::with_what_it_hides(const Named& named) {
  constexpr std::size_t most = 2;
  const Model& one = *named.model;
  std::vector<Contender> candidates;
  if (named.verdict == Verdict::explained) candidates = with_another(one, most, second_evidence);
  if (candidates.empty()) return found(named);
  std::vector<Model> both = fit_and_judge(std::move(candidates), 0.72, 0.82, {.fewer = one.distance});
  const Eigen::VectorXd statistics = as_vector(ground_.real.values->whole);
  std::erase_if(both, [&](const Model& pair) {
    const bool better = likelier(pair, one) || discriminant_odds(pair, one, statistics) > more_odds;
    return !better || !all_significant(pair);
  });
  const auto pair = naming_.choose(both);
  return found(pair ? *pair : named);
}

/// The model with one more effect that speaks for itself in what it leaves, the most promising first.
std::vector<Contender> Search::with_another(const Model& model, std::size_t most, double least_gain) {
  std::vector<Contender> candidates;
  for (const AddedMatch& another :
       match_added(scans_, model, *ground_.plain.standard, seen_, ground_.plan.threads)) {
    if (candidates.size() == most || another.gain < least_gain) break;
    const Scan& scan = scans_[another.scan];
    candidates.push_back({title(model) + " + " + scan.effect->name,
                          with(only(model, model.effects), scan, another.best), another.gain});
  }
  return candidates;
}

/// Of one of the leaders with any other effect, as their fingerprints add up.
std::vector<PairMatch> Search::matched_pairs() const {
  constexpr std::size_t leaders = 4;
  return match_pairs(scans_, leaders, seen_, ground_.plan.threads);
}

/// Whether the scan has two effects that add up to far more than either. Closer looks follow one strong
/// effect so closely that others seem to add to it: before them.
bool Search::two_add_up() const {
  constexpr double far_more = 0.1;  // of the squares of the deviations
  constexpr double far = 2;         // distance of the plain model: of a smaller one it hardly tells
  if (plain_distance(fit_ground(), ground_.plan) < far) return false;
  const std::vector<PairMatch> matches = matched_pairs();
  const double all = 0.5 * std::min(seen_[0].squaredNorm(), seen_[1].squaredNorm());
  return !matches.empty() && matches.front().gain >= far_more * all;
}

/// Two effects before each alone, whose many starts are spared: if neither comes near without the other, and
/// the two explain the frames.
std::optional<Found> Search::clear_pair() {
  constexpr double near_soon = 2;  // distance after the first rounds of a fit
  const std::vector<PairMatch> matches = matched_pairs();
  double alone = 1e300;
  for (const std::size_t one : {matches.front().first, matches.front().second}) {
    alone = std::min(alone, how_near(with(ground_.plain, scans_[one], scans_[one].best().best), 0.58));
    if (alone < far_away) return {};
  }
  std::vector<Model> pairs = fit_and_judge(contenders(matches), 0.6, 0.78,
                                           {.fewer = std::min(alone, near_soon), .as_many = like_own});
  std::erase_if(pairs, [](const Model& pair) { return odd_under(pair) || !all_significant(pair); });
  const auto named = naming_.choose(pairs);
  if (!named || named->verdict != Verdict::explained) return {};
  // Nor from where it is with the other.
  const Model& pair = *named->model;
  for (const std::string& one : pair.effects)
    if (how_near(only(pair, {one}), 0.78) < far_away) return {};
  return found(named);
}

/// The distance from the real frames to which a fit leads the model.
double Search::how_near(Model model, double progress) {
  constexpr int rounds = 10;
  if (ground_.progress) ground_.progress(title(model), progress);
  fit(model, fit_ground(), rounds, ground_.plan, numbers_of("near/" + title(model)));
  return model.distance;
}

/// Pairs whose fingerprints add up best to the real one.
std::vector<Contender> Search::contenders(const std::vector<PairMatch>& matches) {
  constexpr std::size_t most = 4;
  std::vector<Contender> contenders;
  for (std::size_t k = 0; k < std::min(most, matches.size()); ++k)
    // A second effect must speak for itself: many others could soak up a little of what the first leaves.
    if (matches[k].gain >= second_evidence) add_pair(matches[k], contenders);
  return contenders;
}

/// Pairs whose fingerprints add up best; and where one effect takes most of the gap away, those of which the
/// other speaks for itself in what this one leaves: over its whole range a strong one scatters by more than
/// what a weak one does. By all statistics, or by the observable that speaks against the one alone.
std::vector<Contender> Search::contenders_beside(const Model& alone) {
  constexpr double least_of_it = 0.3;  // of what is left of that observable, by the few stacks of the scan
  constexpr std::size_t beside = 2;
  std::vector<Contender> pairs = contenders(matched_pairs());
  if (closed_by(alone, ground_.plain, ground_.battery) < takes_most) return pairs;
  const auto add = [&](Contender&& one) {
    if (std::none_of(pairs.begin(), pairs.end(), [&](const Contender& other) {
          return std::is_permutation(one.model.effects.begin(), one.model.effects.end(),
                                     other.model.effects.begin(), other.model.effects.end());
        }))
      pairs.push_back(std::move(one));
  };
  const Eigen::Index left = naming_.left_by(alone);
  for (Contender& one : with_another(alone, beside, left >= 0 ? if_left : second_evidence))
    add(std::move(one));
  if (left < 0) return pairs;
  const auto others = [&](const Scan& scan) { return !alone.has(scan.effect->name); };
  const std::string& observable = ground_.battery[static_cast<std::size_t>(left)].observable;
  for (const Promising& one : promising_in(observable, least_of_it, beside, others))
    add({title(alone) + " + " + one.scan->effect->name,
         with(only(alone, alone.effects), *one.scan, one.match.best), one.match.share});
  return pairs;
}

/// The most promising pairs, really simulated, beside what single effects leave.
Search::Pairs Search::pairs(std::span<Model> singles) {
  const Model& left_alone = likeliest(singles);
  // One that scatters widely is near though it leaves something: any two that are near are judged then.
  double fewer = nearest_of(singles);
  if (naming_.left_by(left_alone) >= 0) fewer = std::max(fewer, like_own);
  Pairs pairs;
  for (Model& model : fit_and_judge(contenders_beside(left_alone), 0.72, 0.82, {.fewer = fewer})) {
    // Strengths of what comes out differently every time are not known well: then likelihood tells, or what
    // one effect cannot be right about.
    const bool better = likelier(model, left_alone);
    const std::vector<std::string> needed = significant(model);
    if (needed.size() == model.effects.size()) {
      if (model.p_value >= reject_level || (better && leaves_much_less(model, left_alone)))
        pairs.both_needed.push_back(std::move(model));
      continue;
    }
    if (!naming_.passes(model)) continue;
    // It may be the place that the pair's fit found for one of the two that explains.
    if (needed.size() == 1)
      if (Model alone = only(model, needed); !judged_about(alone, singles))
        pairs.needed_alone.push_back({needed.front() + ", of " + title(model), std::move(alone),
                                      scan_of(needed.front()).best().log_likelihood});
    if (better || settles(model, left_alone)) pairs.undecided.push_back(std::move(model));
  }
  return pairs;
}

/// A third effect on top of the pair, by the rule that pairs are judged by, and much likelier: three bend to
/// more than two. Where one of the three is not needed then, the other two, also if they explain it without
/// strengths that are known, or if these do not explain it, all the same the three: strengths of what is few
/// and large or many and small are not known well.
std::vector<Model> Search::triples(const Model& pair) {
  constexpr std::size_t most = 2;
  std::vector<Model> list, two, undecided;
  std::vector<Contender> fewer;
  for (Model& model :
       fit_and_judge(with_another(pair, most, second_evidence), 0.84, 0.85, {.fewer = pair.distance})) {
    const bool better = likelier(model, pair);
    const std::vector<std::string> needed = significant(model);
    if (needed.size() == model.effects.size()) {
      if (better && (model.p_value >= reject_level || leaves_much_less(model, pair)))
        list.push_back(std::move(model));
    } else if (naming_.passes(model)) {
      if (needed.size() == 2) fewer.push_back({title(model) + ", of three", only(model, needed), 0});
      if (better || settles(model, pair)) undecided.push_back(std::move(model));
    }
  }
  for (Model& model : fit_and_judge(std::move(fewer), 0.85, 0.86)) {
    if (all_significant(model))
      list.push_back(std::move(model));
    else if (naming_.passes(model))
      two.push_back(std::move(model));
  }
  if (std::none_of(list.begin(), list.end(), [&](const Model& model) { return naming_.passes(model); }))
    for (Model& model : two.empty() ? undecided : two) list.push_back(std::move(model));
  return list;
}

/// Real cameras have several effects at once, some in no catalogue. One that has a law of its own is named
/// for what it explains in its own observables though others stay odd. So is any effect in frames without
/// atoms: with atoms many effects look like a part of another. One after another, each for what it explains
/// where none before it does. A law and another effect that show in the same observables hide each other:
/// where the law is not found alone, both at once, or the other would bend to what the law does.
std::optional<Found> Search::in_part() {
  constexpr std::size_t most = 3, most_in_vain = 3;  // effects; without a law, in a row
  std::optional<Model> found;
  const auto known = [&]() -> const Model& { return found ? *found : ground_.plain; };
  const auto add = [&](const Scan& scan, const Scan* law) {
    if (known().effects.size() + (law ? 2 : 1) > most) return false;
    std::optional<Model> model = with_part(known(), scan, law);
    if (!model) return false;
    found = std::move(model);
    return true;
  };
  for (const Scan& scan : scans_)
    if (scan.effect->own_law) add(scan, nullptr);
  if (!atoms()) {
    std::set<const Scan*> tried;
    for (std::size_t in_vain = 0; in_vain < most_in_vain;) {
      const Scan* scan = most_promising_part(known(), tried);
      if (!scan) break;
      tried.insert(scan);
      const Scan* law = hidden_beside(*scan, known());
      const bool added = add(*scan, law) || (law && !shows(*law) && add(*scan, nullptr));
      in_vain = added ? 0 : in_vain + 1;
    }
  }
  if (!found) return {};
  const double closed = closed_by(*found, ground_.plain, ground_.battery);
  return atomcam::found(Named{&*found, Verdict::partly_explained, 0.5 + 0.5 * closed, {}});
}

/// Of the effects without a law of their own that were not tried, the one of which the scan says that it
/// takes most of what is odd in its observables away; or none.
const Scan* Search::most_promising_part(const Model& before, const std::set<const Scan*>& tried) const {
  const Scan* best = nullptr;
  double share = 0;
  for (const Scan& scan : scans_) {
    if (scan.effect->own_law || tried.contains(&scan)) continue;
    const auto match = match_part_of_gap(before, scan, hidden_beside(scan, before),
                                         without(scan.effect->observables, before.explains));
    if (match && match->share > share) best = &scan, share = match->share;
  }
  return best;
}

/// An effect with a law of its own that shows in the same observables and is not known yet, or none.
const Scan* Search::hidden_beside(const Scan& scan, const Model& known) const {
  for (const Scan& one : scans_)
    if (one.effect->own_law && !known.has(one.effect->name) && share_observables(*scan.effect, *one.effect))
      return &one;
  return nullptr;
}

PartMatch Search::match_in(const std::vector<std::string>& observables, const Scan& scan,
                           const ScanViews& real) const {
  return match_part(scan, only_of(observables, ground_.battery), real);
}

/// Whether the scan finds some of a law in its observables.
bool Search::shows(const Scan& law) const {
  return match_in(law.effect->observables, law, seen_).share >= law_shows;
}

/// About which parameters the scan finds the effect in these observables, if there is much odd in them and it
/// takes some of that away. Beside a law best where that does not show, or else in what it leaves.
std::optional<PartMatch> Search::match_part_of_gap(const Model& before, const Scan& scan, const Scan* law,
                                                   const std::vector<std::string>& observables) const {
  constexpr double least_gap = 50;    // mean square of the largest deviations of these observables
  constexpr double larger_gap = 200;  // without a law of its own
  constexpr double promising = 0.3;   // part of their squares, by the scan, which does not recalibrate
  const bool own_law = scan.effect->own_law;
  const auto is_odd = [&](const std::vector<std::string>& list, double least) {
    return !list.empty() && gap_of(before.z.cwiseProduct(only_of(list, ground_.battery))) >= least;
  };
  const std::vector<std::string> alone = law ? without(observables, law->effect->observables) : observables;
  std::optional<PartMatch> found;
  if (is_odd(alone, own_law ? least_gap : larger_gap)) {
    found = match_in(alone, scan, seen_);
  } else if (law && is_odd(observables, least_gap)) {
    const ScanViews left = less(seen_, *law, match_in(law->effect->observables, *law, seen_).best);
    found = match_in(observables, scan, left);
  }
  if (found && found->share < (own_law && !atoms() ? law_shows : promising)) return {};
  return found;
}

/// The model with the scan's effect on top, if that explains what is odd in those of its observables that no
/// other effect was named for. `law`: another one beside it, or none.
std::optional<Model> Search::with_part(const Model& before, const Scan& scan, const Scan* law) {
  constexpr double ahead = 0.15;  // of any other effect, of the gap
  constexpr double grown = 1.1;   // the gap elsewhere must not be
  const Model& plain = ground_.plain;
  const bool own_law = scan.effect->own_law;
  std::vector<std::string> observables = without(scan.effect->observables, before.explains);
  std::optional<PartMatch> match = match_part_of_gap(before, scan, law, observables);
  if (!match) return {};
  const Part part{scan, std::move(*match), std::move(observables)};
  std::vector<Model> judged = fit_in_part(before, part, law);
  if (judged.empty()) return {};
  Model& model = judged.front();
  const auto closed_in = [&](const std::vector<std::string>& list) {
    return list.empty() ? 0 : closed_by(model, plain, ground_.battery, list);
  };
  const double closed = closed_in(part.observables);
  if (!all_there(model) || closed < least_part_closed) return {};
  // Nobody's law is all that the law's observables have: what shows elsewhere, too, is judged there.
  if (!own_law && closed < least_closed_if_odd &&
      !(law && closed_in(without(part.observables, law->effect->observables)) >= least_closed_if_odd))
    return {};
  if (law && closed_in(law->effect->observables) < least_part_closed) return {};
  const Eigen::VectorXd others =
      Eigen::VectorXd::Ones(model.z.size()) - only_of(model.explains, ground_.battery);
  const Eigen::VectorXd elsewhere = in_larger_units(*model.standard, *plain.standard).cwiseProduct(others);
  if (gap_of(model.z.cwiseProduct(elsewhere)) > grown * gap_of(before.z.cwiseProduct(others))) return {};
  // One that does not last would take those with it that are named before and after.
  if (closes_too_little(gap_closed(model, plain, *ground_.real.values, ground_.battery), model, plain))
    return {};
  if (closed_by_rival(before, part, law, model) > closed - ahead) return {};
  return std::move(model);
}

/// The model with the scan's effect added, about these parameters; what shapes the mean image as aberrations
/// do with the optics that are known then.
Model Search::with(const Model& before, const Scan& scan, const Eigen::VectorXd& about) {
  Model model;
  model.effects = before.effects;
  model.effects.push_back(scan.effect->name);
  model.lab = before.lab;
  model.open = before.open;
  model.first_effect_parameter = before.first_effect_parameter;
  for (std::size_t k = 0; k < scan.open.size(); ++k) {
    Uncertain one = scan.open[k];
    one.centre = about(static_cast<Eigen::Index>(k));
    one.width = std::clamp(scan.best().width(static_cast<Eigen::Index>(k)), 0.03 * (one.highest - one.lowest),
                           0.08 * (one.highest - one.lowest));
    model.open.push_back(std::move(one));
  }
  const Calibration& calibration = *ground_.real.calibration;
  if (scan.effect->name == field_focus_effect) {
    if (!field_focus_)
      field_focus_ = fit_field_focus(calibration.mean_image, calibration.lab.optics, calibration.optics,
                                     ground_.plan.threads);
    start_at_field_focus(model, *field_focus_, calibration);
  }
  if (scan.effect->name == wandering_effect) hold_zernikes(model, moving_zernikes(), calibration);
  // Of a sharp frequency the statistics say whether there is one, and little of where: its mirror image is a
  // valley of its own.
  if (scan.effect->name == stripes_effect && stripes())
    start_at(model, {{fmt::format("effects.{}.period_px", stripes_effect), stripes()->period_px},
                     {fmt::format("effects.{}.row_phase_deg", stripes_effect), stripes()->row_phase_deg}});
  return model;
}

const std::optional<Stripes>& Search::stripes() {
  if (!stripes_) {
    const FrameSequence* without_atoms = atoms() ? ground_.darks : &ground_.frames;
    stripes_ = without_atoms ? strongest_stripes(*without_atoms) : std::nullopt;
  }
  return *stripes_;
}

/// The model with only these of its effects, about what was estimated with the others.
Model Search::only(const Model& model, const std::vector<std::string>& names) const {
  const Model& plain = ground_.plain;
  Model one;
  one.effects = names;
  one.lab = model.lab;
  one.first_effect_parameter = model.first_effect_parameter;
  for (std::size_t k = 0; k < model.open.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(k);
    Uncertain open = at < plain.first_effect_parameter ? plain.open[k] : model.open[k];
    if (at >= plain.first_effect_parameter && !open.is_of(names)) continue;
    open.centre = model.open[k].within(model.estimate(at));
    one.open.push_back(std::move(open));
  }
  return one;
}

/// By so much that there is one effect more.
bool Search::likelier(const Model& model, const Model& fewer) const {
  return Rivals(model, fewer).odds(as_vector(ground_.real.values->whole)) > more_odds;
}

/// Fewer effects cannot be right about something, and most of that is gone with one more.
bool Search::settles(const Model& model, const Model& fewer) const {
  const Eigen::Index left = naming_.contradicted(fewer) ? naming_.left_by(fewer) : -1;
  return left >= 0 && std::fabs(model.z(left)) < 0.5 * std::fabs(fewer.z(left));
}

/// Fitted and judged, noted among the hypotheses.
std::vector<Model> Search::fit_and_judge(std::vector<Contender> contenders, double from, double to,
                                         const Before& before) {
  const auto progress = [&](std::string_view step, double done) {
    if (ground_.progress) ground_.progress(step, from + done * (to - from));
  };
  add_starts_of_shaking(contenders);
  std::vector<Model> judged;
  for (Contender& one : fitted_and_judged(std::move(contenders), fit_ground(), ground_.battery, before,
                                          ground_.plan, progress, ends_)) {
    note(one.model, one.evidence);
    judged.push_back(std::move(one.model));
  }
  return judged;
}

/// Of images that shake from frame to frame, another start of the first of each combination of effects.
/// Alone, across: an astigmatism that made up for the blur shows a fit the wrong direction, and on its way
/// back it ends where images shake alike in all directions. Beside another effect, with the optics that they
/// have then: others, which make up for a shaking in a wrong direction, keep it there.
void Search::add_starts_of_shaking(std::vector<Contender>& contenders) {
  const Calibration& calibration = *ground_.real.calibration;
  std::set<std::vector<std::string>> seen;
  for (std::size_t k = 0, count = contenders.size(); k < count; ++k) {
    const Model& model = contenders[k].model;
    const bool held = std::any_of(model.open.begin(), model.open.end(), [](auto& one) { return one.held; });
    if (!model.has(shaking_effect) || held || !seen.insert(model.effects).second) continue;
    Contender start{contenders[k].name, model.unjudged(), contenders[k].evidence};
    if (model.effects.size() == 1) {
      start.name += ", across";
      for (Uncertain& one : start.model.open)
        if (one.cycle > 0) one.centre = one.within(one.centre + one.cycle / 2);
    } else {
      if (!are_others(ground_.plain, moving_zernikes(), calibration)) continue;
      start.name += ", optics held";
      start.lets_go = true;
      hold_zernikes(start.model, moving_zernikes(), calibration);
    }
    contenders.push_back(std::move(start));
  }
}

const std::array<double, zernike_terms>& Search::moving_zernikes() {
  if (!moving_zernikes_)
    moving_zernikes_ =
        zernikes_of_moving_image(*ground_.real.calibration, ground_.frames, ground_.plan.threads);
  return *moving_zernikes_;
}

void Search::note(const Model& model, double evidence) {
  Hypothesis one;
  one.effects = model.effects;
  one.log_evidence = evidence;
  one.p_value = model.p_value;
  one.closed = closed_by(model, ground_.plain, ground_.battery);
  one.why_not = naming_.objection(model);
  if (one.why_not.empty()) one.why_not = naming_.not_known(model);
  one.not_seen = !naming_.not_seen(model).empty();
  hypotheses.push_back(std::move(one));
}

/// Those of the scans asked for of which the most matches, the best first.
std::vector<Search::Promising> Search::promising(const std::function<PartMatch(const Scan&)>& match,
                                                 double least, std::size_t most, const Asked& asked) const {
  std::vector<Promising> list;
  for (const Scan& one : scans_)
    if (asked(one))
      if (PartMatch found = match(one); found.share > least) list.push_back({&one, std::move(found)});
  std::stable_sort(list.begin(), list.end(), [](const Promising& one, const Promising& other) {
    return one.match.share > other.match.share;
  });
  if (list.size() > most) list.resize(most);
  return list;
}

/// Those that take most of what is odd in an observable away.
std::vector<Search::Promising> Search::promising_in(const std::string& observable, double least,
                                                    std::size_t most, const Asked& asked) const {
  return promising([&](const Scan& scan) { return match_in({observable}, scan, seen_); }, least, most, asked);
}

/// What was not fitted yet though the scan says that it would take much away. Of a large gap the few stacks
/// of a scan hardly tell which effect makes it: calibration follows, and no place of the scan is near. Of a
/// small one that a few statistics show it says little, as hundreds of others scatter: there what takes most
/// of the oddest observable away counts, also if a fit from elsewhere has left it.
std::vector<Contender> Search::overlooked(std::span<const Model> judged) {
  constexpr double least_share = 0.1, least_of_oddest = 0.5;
  constexpr std::size_t most = 4, most_by_oddest = 3;
  const auto not_fitted = [&](const Scan& scan) { return !end_alone(scan); };
  std::vector<Promising> list = promising(
      [](const Scan& scan) {
        return PartMatch{scan.best().share, scan.best().best};
      },
      least_share, most, not_fitted);
  const std::string oddest = most_missed(ground_.plain, ground_.battery);
  const auto leaves_oddest = [&](const Model& model) {
    const Eigen::Index left = naming_.left_by(model);
    return left >= 0 && ground_.battery[static_cast<std::size_t>(left)].observable == oddest;
  };
  const auto not_fitted_there = [&](const Scan& scan) {
    const std::vector<std::string> alone{scan.effect->name};
    return not_fitted(scan) || std::any_of(judged.begin(), judged.end(), [&](const Model& model) {
             return model.effects == alone && leaves_oddest(model);
           });
  };
  for (Promising& one : promising_in(oddest, least_of_oddest, most_by_oddest, not_fitted_there))
    if (std::none_of(list.begin(), list.end(), [&](const Promising& seen) { return seen.scan == one.scan; }))
      list.push_back(std::move(one));
  std::vector<Contender> contenders;
  for (const Promising& one : list)
    contenders.push_back({one.scan->effect->name + (end_alone(*one.scan) ? ", oddest" : ""),
                          with(ground_.plain, *one.scan, one.match.best), one.scan->best().log_likelihood});
  return contenders;
}

/// Both effects as their fingerprints add up best, and each as it ended alone: what two strong effects do
/// does not add up.
void Search::add_pair(const PairMatch& match, std::vector<Contender>& candidates) {
  const Scan &one = scans_[match.first], &two = scans_[match.second];
  const std::string names = one.effect->name + " + " + two.effect->name;
  candidates.push_back(
      {names, with(with(ground_.plain, one, match.best_first), two, match.best_second), match.gain});
  const auto first_alone = end_alone(one), second_alone = end_alone(two);
  if (first_alone && second_alone)
    candidates.push_back({names + ", each as alone",
                          with(with(ground_.plain, one, *first_alone), two, *second_alone), match.gain});
}

/// Where the effect ended when it was fitted alone, if it was.
std::optional<Eigen::VectorXd> Search::end_alone(const Scan& scan) const {
  const auto at_end = ends_.find({scan.effect->name});
  if (at_end == ends_.end()) return {};
  const auto count = static_cast<Eigen::Index>(scan.open.size());
  const auto from = std::ssize(at_end->second) - count;
  Eigen::VectorXd end(count);
  for (Eigen::Index k = 0; k < count; ++k) end(k) = at_end->second[static_cast<std::size_t>(from + k)].centre;
  return end;
}

const Scan& Search::scan_of(const std::string& name) const {
  return *std::find_if(scans_.begin(), scans_.end(),
                       [&](const Scan& one) { return one.effect->name == name; });
}

/// With the part's effect on top, and a law beside it or none, for their observables as well: one model or
/// none.
std::vector<Model> Search::fit_in_part(const Model& before, const Part& part, const Scan* law) {
  Model model = before.effects.empty() ? before.unjudged() : only(before, before.effects);
  std::vector<std::string> explains = before.explains;
  const auto explain = [&](const std::vector<std::string>& more) {
    for (const std::string& one : without(more, explains)) explains.push_back(one);
  };
  if (law) {
    const std::vector<std::string>& own = law->effect->observables;
    const ScanViews left = less(seen_, part.scan, part.match.best);
    model = with(model, *law, match_in(own, *law, left).best);
    explain(own);
  }
  model = with(model, part.scan, part.match.best);
  explain(part.observables);
  model.explains = std::move(explains);
  std::vector<Contender> contenders;
  contenders.push_back({title(model) + ", in part", std::move(model), part.scan.best().log_likelihood});
  // How many parts there will be is not known: each takes some of the progress that is left.
  const double from = part_progress_;
  part_progress_ += 0.15 * (1 - from);
  return fit_and_judge(std::move(contenders), from, part_progress_, {.part = part.observables});
}

/// What the other effect that the scan finds most of in the part's observables closes of their gap. Nothing,
/// in frames without atoms, if it is far less likely all in all: what it does elsewhere is not there.
double Search::closed_by_rival(const Model& before, const Part& part, const Scan* law, const Model& model) {
  constexpr double far_less = 30;  // of the logarithmic likelihood
  const Scan* rival = nullptr;
  PartMatch best;
  for (const Scan& other : scans_)
    if (PartMatch match = match_in(part.observables, other, seen_); &other != &part.scan && &other != law &&
                                                                    !before.has(other.effect->name) &&
                                                                    match.share > best.share) {
      rival = &other;
      best = std::move(match);
    }
  if (!rival) return 0;
  const std::vector<Model> judged = fit_in_part(before, {*rival, std::move(best), part.observables}, law);
  if (judged.empty()) return 0;
  if (!atoms() && judged.front().log_likelihood < model.log_likelihood - far_less) return 0;
  return closed_by(judged.front(), ground_.plain, ground_.battery, part.observables);
}

}  // namespace atomcam
