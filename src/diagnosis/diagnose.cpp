#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <span>

#include "base/error.hpp"
#include "diagnosis/contenders.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/gap_closed.hpp"
#include "diagnosis/known_optics.hpp"
#include "diagnosis/model.hpp"
#include "diagnosis/naming.hpp"
#include "diagnosis/rivals.hpp"
#include "diagnosis/scan.hpp"
#include "diagnosis/stages.hpp"

namespace atomcam {
namespace {

constexpr double second_evidence = 12;  // logarithm, for another effect on top of one
constexpr double pair_odds = 5;         // logarithm, over the likeliest of one effect, for two

// Of the gap on held-out frames, for an effect to be named; and under which the frames are so odd that only
// a large gap that it takes away lets it pass.
constexpr double least_closed = 0.75, least_closed_if_rejected = 0.96;
constexpr double least_part_closed = 0.75;  // of the gap in its own observables, for an effect to be named

constexpr std::uintmax_t largest_cache = std::uintmax_t{4} << 30;

/// All counts of a stack.
std::string digest_of(const FrameSequence& frames) {
  Sha256 hash;
  frames.visit([&](std::size_t, const CountImage& frame) {
    for (int row = 0; row < frame.rows(); ++row)
      hash.add(frame.row(row).data(), sizeof(std::uint16_t) * static_cast<std::size_t>(frame.columns()));
  });
  return hash.digits();
}

class Diagnoser {
 public:
  Diagnoser(const Notes& notes, const FrameSequence& frames, const FrameSequence* darks,
            const DiagnosisOptions& options)
      : notes_(notes), frames_(frames), darks_(darks), options_(options) {}

  Diagnosis run() {
    const auto start = std::chrono::steady_clock::now();
    prepare();
    judge_plain();
    if (result_.p_gap < gap_level && !options_.where_only) {
      explain();
      if (!have_final_) explain_in_part();
    }
    conclude();
    result_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return std::move(result_);
  }

 private:
  void tell(std::string_view step, double done) const {
    if (options_.progress) options_.progress(step, done);
  }
  /// Progress of one population as a part of the whole.
  std::function<void(int)> part(const std::string& step, double from, double to, int stacks) const {
    if (!options_.progress) return {};
    return [this, step, from, to, stacks](int done) {
      options_.progress(step, from + (to - from) * std::min(1.0, static_cast<double>(done) / stacks));
    };
  }

  void prepare() {
    tell("calibrating", 0);
    CalibrationInput input;
    input.notes = notes_;
    input.frames = &frames_;
    input.darks = darks_;
    options_.beside.add_to(input);
    result_.calibration = calibrate(input);
    plan_.model = result_.calibration.model;
    plan_.frames = frames_.frames();
    plan_.dark_frames = darks_ ? darks_->frames() : 0;
    plan_.split = split_of(plan_.frames, options_.block);
    plan_.seed = options_.seed;
    plan_.threads = options_.threads;
    plan_.check_in = options_.check_in;
    tell("measuring the frames", 0.03);
    declarations_ = battery(plan_.model, darks_ != nullptr);
    real_ = measure(plan_.model, frames_, darks_, plan_.split);
    if (!options_.cache.empty()) {
      // All that is simulated follows from these and the steps' own numbers.
      kept_.emplace(options_.cache,
                    digest_of(frames_) + (darks_ ? digest_of(*darks_) : "") +
                        (options_.beside.background ? digest_of(*options_.beside.background) : "") +
                        write_lab(result_.calibration.lab) + std::to_string(plan_.split.block));
      plan_.kept = &*kept_;
    }
  }

  void judge_plain() {
    const double cost = static_cast<double>(plan_.frames) * static_cast<double>(frames_.shape().pixels());
    const int stacks = cost > 3e7 ? 160 : 240;
    plain_ = plain_model(real_stack(), stacks, plan_,
                         part("plain model", 0.04, 0.25, plain_centre_stacks + stacks));
    result_.p_gap = plain_.p_value;
    result_.p_after = plain_.p_value;
  }

  std::vector<std::string> excluded() const {
    std::vector<std::string> list = options_.exclude;
    if (!options_.include.empty())
      for (const EffectDeclaration& effect : effect_catalogue())
        if (std::find(options_.include.begin(), options_.include.end(), effect.name) ==
            options_.include.end())
          list.push_back(effect.name);
    return list;
  }

  std::vector<Scan> scan(const Model& before, const ScanViews& real, double from, double to) {
    std::vector<Scan> scans;
    const auto list = candidates(before, excluded());
    for (std::size_t k = 0; k < list.size(); ++k) {
      Scan one;
      one.effect = list[k];
      const double a = from + (to - from) * static_cast<double>(k) / static_cast<double>(list.size());
      const double b = from + (to - from) * static_cast<double>(k + 1) / static_cast<double>(list.size());
      const int stacks = 12 + 3 * static_cast<int>(one.effect->parameters.size());
      explore(one, before, stacks, plan_, numbers_of("scan/" + one.effect->name),
              part(one.effect->name, a, b, stacks));
      scans.push_back(std::move(one));
    }
    match(scans, *before.correlation, real, plan_.threads);
    sort(scans);
    return scans;
  }
  static void sort(std::vector<Scan>& scans) {
    std::sort(scans.begin(), scans.end(),
              [](const Scan& a, const Scan& b) { return a.best().log_likelihood > b.best().log_likelihood; });
  }

  /// The model with the scan's effect added, about these parameters; what shapes the mean image as
  /// aberrations do with the optics that are known then.
  Model with(const Model& before, const Scan& scan, const Eigen::VectorXd& about) {
    Model model;
    model.effects = before.effects;
    model.effects.push_back(scan.effect->name);
    model.lab = before.lab;
    model.open = before.open;
    model.first_effect_parameter = before.first_effect_parameter;
    for (std::size_t k = 0; k < scan.open.size(); ++k) {
      Uncertain one = scan.open[k];
      one.centre = about(static_cast<Eigen::Index>(k));
      one.width = std::clamp(scan.best().width(static_cast<Eigen::Index>(k)),
                             0.03 * (one.highest - one.lowest), 0.08 * (one.highest - one.lowest));
      model.open.push_back(std::move(one));
    }
    if (scan.effect->name == field_focus_effect) {
      const Calibration& calibration = result_.calibration;
      if (!field_focus_)
        field_focus_ = fit_field_focus(calibration.mean_image, calibration.lab.optics, calibration.optics);
      start_at_field_focus(model, *field_focus_, calibration);
    }
    if (scan.effect->name == wandering_effect) {
      if (!moving_zernikes_) moving_zernikes_ = zernikes_of_moving_image(result_.calibration, frames_);
      hold_zernikes(model, *moving_zernikes_, result_.calibration);
    }
    return model;
  }

  /// Fitted and judged, noted among the hypotheses.
  std::vector<Model> fit_and_judge(std::vector<Contender> contenders, double from, double to,
                                   double alone = 1e300) {
    const auto progress = [&](const std::string& step, double done) {
      tell(step, from + done * (to - from));
    };
    std::vector<Model> judged;
    for (Contender& one : fitted_and_judged(std::move(contenders), {&plain_, real_stack()}, declarations_,
                                            alone, plan_, progress, ends_)) {
      note(one.model, one.evidence);
      judged.push_back(std::move(one.model));
    }
    return judged;
  }

  RealStack real_stack() const {
    RealStack real{&real_, &result_.calibration, &notes_};
    if (options_.beside.background) {
      real.background_frames = options_.beside.background->frames();
      real.background_exposure_s = options_.beside.background_exposure_s;
    }
    return real;
  }

  double closed_by(const Model& model) const { return atomcam::closed_by(model, plain_, declarations_); }
  Eigen::VectorXd only_of(const std::vector<std::string>& observables) const {
    return atomcam::only_of(observables, declarations_);
  }

  void note(const Model& model, double evidence) {
    Hypothesis one;
    one.effects = model.effects;
    one.log_evidence = evidence;
    one.p_value = model.p_value;
    one.closed = closed_by(model);
    if (model.p_value < reject_level) {
      Eigen::Index worst = 0;
      model.z.cwiseAbs().maxCoeff(&worst);
      one.why_not = fmt::format("leaves {} at {:+.1f} sigma",
                                declarations_[static_cast<std::size_t>(worst)].name, model.z(worst));
    }
    result_.hypotheses.push_back(std::move(one));
  }

  void explain() {
    const ScanViews real = views_of(*plain_.standard, as_vector(real_.whole));
    scans_ = scan(plain_, real, 0.25, 0.5);
    std::vector<Scan>& scans = scans_;
    // Closer and closer looks at fewer and fewer.
    double done = 0.5;
    for (const std::size_t leaders : {8u, 6u, 5u, 4u}) {
      const std::span<Scan> nearest(scans.data(), std::min(leaders, scans.size()));
      for (Scan& one : nearest) {
        explore(one, plain_, 8, plan_, numbers_of(fmt::format("look {}/{}", leaders, one.effect->name)),
                part(one.effect->name, done, done + 0.0035, 8));
        done += 0.0035;
      }
      match(nearest, *plain_.correlation, real, plan_.threads);
      sort(scans);
    }
    for (const Scan& one : scans) {
      Hypothesis seen;
      seen.effects = {one.effect->name};
      seen.log_evidence = one.best().log_likelihood;
      seen.share = one.best().share;
      result_.hypotheses.push_back(std::move(seen));
    }
    constexpr double clear_share = 0.2;  // of the misfit: this effect is likely there
    std::vector<Contender> contenders;
    for (std::size_t k = 0; k < std::min<std::size_t>(6, scans.size()); ++k) {
      const ScanView& view = scans[k].best();
      // Beyond the first two only what the scan speaks for.
      if (k > 1 && view.log_likelihood < std::max(0.0, 0.4 * scans[0].best().log_likelihood - 20)) break;
      std::vector<Eigen::VectorXd> places;
      const auto start_at = [&](const Eigen::VectorXd& place, const char* why) {
        for (const Eigen::VectorXd& other : places)
          if (((place - other).cwiseAbs().array() <= view.width.array()).all()) return;
        places.push_back(place);
        contenders.push_back(
            {scans[k].effect->name + why, with(plain_, scans[k], place), view.log_likelihood});
      };
      start_at(view.best, "");
      if (k >= 3 || scans[k].effect->name == field_focus_effect) continue;
      // Also where the other view has it, if it speaks for the effect as well, and from the stack that really
      // came nearest: the emulator may have led elsewhere.
      const ScanView& other = scans[k].view[1 - scans[k].clearest()];
      if (other.log_likelihood > 0.8 * view.log_likelihood - 5) start_at(other.best, ", other view");
      Eigen::Index at = 0;
      view.miss.minCoeff(&at);
      start_at(scans[k].draws.row(at).transpose(), ", nearest");
      if (k >= 2 || view.share < clear_share) continue;
      // And the effect in its usual form: far from it a valley may lead away.
      start_at(view.usual, ", usual");
    }
    std::vector<Model> singles = fit_and_judge(std::move(contenders), 0.58, 0.75);
    if (choose(singles)) return;
    for (Model& model : fit_and_judge(overlooked(scans), 0.75, 0.8)) singles.push_back(std::move(model));
    if (choose(singles)) return;
    // Pairs: those whose fingerprints add up best to the real one, then really simulated.
    if (singles.empty()) return;
    const Model& left_alone = likeliest(singles);
    const std::vector<PairMatch> matches = match_pairs(scans, 4, real, plan_.threads);
    std::vector<Contender> candidates;
    for (std::size_t k = 0; k < std::min<std::size_t>(4, matches.size()); ++k)
      // A second effect must speak for itself: many others could soak up a little of what the first leaves.
      if (matches[k].gain >= second_evidence) add_pair(matches[k], candidates);
    std::vector<Model> pairs, undecided;
    std::vector<Contender> lone;
    double alone = 1e300;
    for (const Model& model : singles) alone = std::min(alone, model.distance);
    for (Model& model : fit_and_judge(std::move(candidates), 0.8, 0.95, alone)) {
      // Strengths of what comes out differently every time are not known well: then likelihood tells, or what
      // one effect cannot be right about.
      const bool likelier = Rivals(model, left_alone).odds(as_vector(real_.whole)) > pair_odds;
      const std::vector<std::string> needed = significant(model);
      if (needed.size() < model.effects.size()) {
        if (!naming_.passes(model)) continue;
        // It may be the place that the pair's fit found for one of the two that explains.
        if (needed.size() == 1)
          lone.push_back({needed.front() + ", of " + title(model), only(model, needed.front()),
                          evidence_for(needed.front())});
        if (likelier || naming_.contradicted(left_alone)) undecided.push_back(std::move(model));
        continue;
      }
      // The pair must leave much less than the better of the two alone, in its own standard deviations.
      const bool better = likelier && model.gap - model.floor < 0.3 * (left_alone.gap - left_alone.floor);
      if (model.p_value >= reject_level || better) pairs.push_back(std::move(model));
    }
    if (choose(pairs)) return;
    for (Model& model : fit_and_judge(std::move(lone), 0.95, 1)) singles.push_back(std::move(model));
    if (choose(singles)) return;
    const Model& either = likeliest(singles);
    std::erase_if(undecided, [&](const Model& model) {
      return Rivals(model, either).odds(as_vector(real_.whole)) < pair_odds && !naming_.contradicted(either);
    });
    if (choose(undecided)) return;
    std::vector<Model> all;
    for (auto& m : singles) all.push_back(std::move(m));
    for (auto& m : pairs) all.push_back(std::move(m));
    accept(naming_.nearest(all));
  }

  /// Real cameras have several effects at once, some in no catalogue. One that has a law of its own is named
  /// for what it explains in its own observables though others stay odd. So is any effect in frames without
  /// atoms, if what it explains is most of what is odd: with atoms many effects look like a part of another.
  void explain_in_part() {
    const ScanViews real = views_of(*plain_.standard, as_vector(real_.whole));
    constexpr double least_gap = 50;    // mean square of the largest deviations of these observables
    constexpr double larger_gap = 200;  // without a law of its own
    constexpr double promising = 0.3;   // part of their squares, by the scan, which does not recalibrate
    constexpr double ahead = 0.15;      // of any other effect, of the gap
    constexpr double grown = 1.1;       // the gap elsewhere must not be
    constexpr double foremost = 0.25;   // nor, beside what the effect explains, without a law of its own
    const bool atoms = !plain_.lab.scene.sites.empty();
    for (const Scan& scan : scans_) {
      const bool own_law = scan.effect->own_law;
      if (!own_law && atoms) continue;
      const std::vector<std::string>& observables = scan.effect->observables;
      const Eigen::VectorXd own = only_of(observables);
      const Eigen::VectorXd others = Eigen::VectorXd::Ones(own.size()) - own;
      const double gap = gap_of(plain_.z.cwiseProduct(own));
      if (gap < (own_law ? least_gap : larger_gap)) continue;
      const PartMatch match = match_part(scan, own, real);
      if (match.share < promising) continue;
      std::vector<Model> judged = fit_in_part(scan, match, observables);
      if (judged.empty()) continue;
      Model& model = judged.front();
      const Eigen::VectorXd elsewhere =
          in_larger_units(*model.standard, *plain_.standard).cwiseProduct(others);
      const double closed = closed_by(model), left = gap_of(model.z.cwiseProduct(elsewhere));
      if (significant(model).empty() || closed < (own_law ? least_part_closed : least_closed_if_odd) ||
          left > grown * gap_of(plain_.z.cwiseProduct(others)) || (!own_law && left > foremost * gap))
        continue;
      if (closed_by_rival(scan, model, own, real) > closed - ahead) continue;
      accept(Named{&model, Verdict::partly_explained, 0.5 + 0.5 * closed, {}});
      result_.p_after = result_.p_gap;
      return;
    }
  }

  /// What was not fitted yet though the scan says that it would take much away. Of a large gap the few stacks
  /// of a scan hardly tell which effect makes it: calibration follows, and no place of the scan is near.
  std::vector<Contender> overlooked(const std::vector<Scan>& scans) {
    constexpr double least_share = 0.1;
    constexpr std::size_t most = 4;
    std::vector<const Scan*> list;
    for (const Scan& one : scans)
      if (one.best().share > least_share && !end_alone(one)) list.push_back(&one);
    std::stable_sort(list.begin(), list.end(),
                     [](const Scan* a, const Scan* b) { return a->best().share > b->best().share; });
    if (list.size() > most) list.resize(most);
    std::vector<Contender> contenders;
    for (const Scan* one : list) {
      const ScanView& view = one->best();
      contenders.push_back({one->effect->name, with(plain_, *one, view.best), view.log_likelihood});
    }
    return contenders;
  }

  /// Both effects as their fingerprints add up best, and each as it ended alone: what two strong effects do
  /// does not add up.
  void add_pair(const PairMatch& match, std::vector<Contender>& candidates) {
    const Scan &one = scans_[match.first], &two = scans_[match.second];
    const std::string names = one.effect->name + " + " + two.effect->name;
    candidates.push_back(
        {names, with(with(plain_, one, match.best_first), two, match.best_second), match.gain});
    const auto first_alone = end_alone(one), second_alone = end_alone(two);
    if (first_alone && second_alone)
      candidates.push_back(
          {names + ", each as alone", with(with(plain_, one, *first_alone), two, *second_alone), match.gain});
  }

  /// Where the effect ended when it was fitted alone, if it was.
  std::optional<Eigen::VectorXd> end_alone(const Scan& scan) const {
    const auto found = ends_.find({scan.effect->name});
    if (found == ends_.end()) return {};
    const auto count = static_cast<Eigen::Index>(scan.open.size());
    const auto from = std::ssize(found->second) - count;
    Eigen::VectorXd end(count);
    for (Eigen::Index k = 0; k < count; ++k)
      end(k) = found->second[static_cast<std::size_t>(from + k)].centre;
    return end;
  }

  /// One model or none.
  std::vector<Model> fit_in_part(const Scan& scan, const PartMatch& match,
                                 const std::vector<std::string>& observables) {
    std::vector<Contender> contenders;
    contenders.push_back(
        {scan.effect->name + ", in part", with(plain_, scan, match.best), scan.best().log_likelihood});
    contenders.back().model.explains = observables;
    return fit_and_judge(std::move(contenders), 0.95, 1);
  }

  /// What the other effect that the scan finds most of in these observables closes of their gap. Nothing,
  /// beside an effect without a law of its own, if it is far less likely all in all: what it does elsewhere
  /// is not there.
  double closed_by_rival(const Scan& scan, const Model& model, const Eigen::VectorXd& own,
                         const ScanViews& real) {
    constexpr double far_less = 30;  // of the logarithmic likelihood
    const Scan* rival = nullptr;
    PartMatch best;
    for (const Scan& other : scans_)
      if (PartMatch match = match_part(other, own, real); &other != &scan && match.share > best.share) {
        rival = &other;
        best = std::move(match);
      }
    if (!rival) return 0;
    const std::vector<Model> judged = fit_in_part(*rival, best, model.explains);
    if (judged.empty()) return 0;
    if (!scan.effect->own_law && judged.front().log_likelihood < model.log_likelihood - far_less) return 0;
    return closed_by(judged.front());
  }

  /// The effects whose strength is some errors away from nothing.
  static std::vector<std::string> significant(const Model& model) {
    std::vector<std::string> list;
    for (const std::string& name : model.effects) {
      const std::string key = "effects." + name + "." + find_effect(name)->parameters.front().key;
      const bool clear = std::none_of(model.open.begin(), model.open.end(), [&](const Uncertain& one) {
        const auto at = static_cast<Eigen::Index>(&one - model.open.data());
        return one.name == key && (model.error(at) > 0.3 || model.estimate(at) < one.lowest + 0.2);
      });
      if (clear) list.push_back(name);
    }
    return list;
  }

  double evidence_for(const std::string& name) const {
    for (const Scan& one : scans_)
      if (one.effect->name == name) return one.best().log_likelihood;
    return 0;
  }

  /// The model with one of its effects alone, about what was estimated with the others.
  Model only(const Model& model, const std::string& name) const {
    Model one;
    one.effects = {name};
    one.lab = model.lab;
    one.first_effect_parameter = model.first_effect_parameter;
    for (std::size_t k = 0; k < model.open.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(k);
      Uncertain open = at < plain_.first_effect_parameter ? plain_.open[k] : model.open[k];
      if (at >= plain_.first_effect_parameter && !open.name.starts_with("effects." + name + ".")) continue;
      open.centre = std::clamp(model.estimate(at), model.open[k].lowest, model.open[k].highest);
      one.open.push_back(std::move(open));
    }
    return one;
  }

  /// Whether one of the models explains the frames; it is the result then.
  bool choose(std::span<Model> models) { return accept(naming_.choose(models)); }

  bool accept(const std::optional<Named>& named) {
    if (!named) return false;
    result_.verdict = named->verdict;
    result_.effects = found_effects(*named);
    result_.p_after = named->model->p_value;
    final_ = std::move(*named->model);
    have_final_ = true;
    return true;
  }

  /// Before and after on the held-out frames.
  void how_far() {
    result_.gap = have_final_ ? gap_closed(final_, plain_, real_, declarations_) : gap_left(plain_, real_);
    if (have_final_) list_steps();
  }

  /// Of several effects: the gap with only the first ones, calibration being free to follow.
  void list_steps() {
    GapClosed& gap = result_.gap;
    const Standard before(plain_.population, Part::held_out);
    const Eigen::VectorXd fitted = fitted_to_first_part(final_, real_);
    const Eigen::VectorXd held_out = as_vector(real_.part[1]);
    for (std::size_t count = 1; count < final_.effects.size(); ++count) {
      Model fewer = final_.with_first_effects(count, fitted);
      const std::string step_name = title(fewer);
      recalibrate(fewer, real_stack(), plan_, numbers_of("step calibration/" + step_name));
      fewer.population =
          simulate_population(fewer.lab, fewer.open, 40, plan_, numbers_of("step/" + step_name));
      const Standard step(fewer.population, Part::held_out, {}, {}, effects_reach);
      gap.steps.push_back(
          {fewer.effects.back(), gap_of(step.judge(held_out).cwiseProduct(in_larger_units(step, before)))});
    }
    gap.steps.push_back({final_.effects.back(), gap.after});
  }

  void ask_others() {
    tell("second opinions", 0.99);
    const OpinionModel plain = opinion_model(plain_, real_, result_.p_gap < gap_level);
    const OpinionModel fixed = have_final_ ? opinion_model(final_, real_) : OpinionModel{};
    result_.gap.second_opinions =
        second_opinions(frames_, plan_, plain, have_final_ ? &fixed : nullptr, numbers_of("opinions"));
  }

  /// Isolability: which other effects could pass for the one that was found, at this amount of data.
  void tell_apart() {
    if (!have_final_ || final_.effects.size() != 1) return;
    const auto found = std::find_if(scans_.begin(), scans_.end(),
                                    [&](const Scan& one) { return one.effect->name == final_.effects[0]; });
    if (found == scans_.end()) return;
    for (const Scan& other : scans_)
      for (Hypothesis& one : result_.hypotheses)
        if (&other != &*found && one.effects == std::vector{other.effect->name})
          one.imitates = imitated(found->best().predicted, other, found->clearest());
  }

  /// What was fitted to one half of the frames and takes nothing off the other was chance.
  void withdraw() {
    for (Hypothesis& one : result_.hypotheses)
      if (one.effects == final_.effects && one.p_value >= 0 && one.why_not.empty())
        one.why_not = fmt::format("closes {:.0f} % of the gap on held-out frames", 100 * result_.gap.closed);
    have_final_ = false;
    result_.effects.clear();
    result_.verdict = Verdict::unexplained;
    result_.p_after = result_.p_gap;
    result_.gap = {};
    how_far();
  }

  /// At the best of what held-out frames may mean; as they are, where all frames are a little odd as well.
  bool closes_too_little() const {
    const GapClosed& gap = result_.gap;
    if (!final_.explains.empty()) return gap.part_closed_high < least_part_closed;
    if (final_.p_value < reject_level) return gap.closed < least_closed_if_rejected;
    return odd_under(final_) ? gap.closed < least_closed_if_odd : gap.closed_high < least_closed;
  }

  void conclude() {
    how_far();
    if (have_final_ && closes_too_little()) withdraw();
    tell_apart();
    if (!options_.where_only) ask_others();
    result_.where = ranked_differences(declarations_, plain_.z, have_final_ ? final_.z : plain_.z);
    result_.plain_lab = plain_.fitted_lab();
    result_.lab = have_final_ ? final_.fitted_lab() : plain_.fitted_lab();
    if (result_.verdict == Verdict::no_gap && result_.p_gap < gap_level)
      result_.verdict = Verdict::unexplained;
    if (result_.verdict == Verdict::unexplained)
      result_.unexplained = unexplained_of(declarations_, plain_.z, result_.hypotheses);
    else if (have_final_ && result_.p_after < reject_level)
      result_.unexplained = unexplained_of(declarations_, final_.z);
    result_.next_measurement = next_measurements(result_, darks_ != nullptr);
    result_.sentence = sentence_of(result_);
    if (kept_) kept_->trim(largest_cache);
    tell("done", 1);
  }

  const Notes& notes_;
  const FrameSequence& frames_;
  const FrameSequence* darks_;
  const DiagnosisOptions& options_;
  Diagnosis result_;
  StackPlan plan_;
  std::optional<KeptResults> kept_;
  std::vector<StatisticDeclaration> declarations_;
  BatteryValues real_;
  Model plain_, final_;
  Naming naming_{plain_, real_, declarations_};
  std::vector<Scan> scans_;
  Ends ends_;
  bool have_final_ = false;
  std::optional<FieldFocus> field_focus_;
  std::optional<std::array<double, zernike_terms>> moving_zernikes_;
};

}  // namespace

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_gap:
      return "no_gap";
    case Verdict::explained:
      return "explained";
    case Verdict::partly_explained:
      return "partly_explained";
    case Verdict::unexplained:
      return "unexplained";
    case Verdict::ambiguous:
      return "ambiguous";
  }
  return "";
}

Diagnosis diagnose(const Notes& notes, const FrameSequence& frames, const FrameSequence* darks,
                   const DiagnosisOptions& options) {
  for (const auto* list : {&options.exclude, &options.include})
    for (const std::string& name : *list) stage_of(name);
  const std::size_t least = notes.grid ? 40 : 10;  // loss and filling take more frames than a camera's noise
  if (frames.frames() < least)
    throw Error("frames", fmt::format("{} frames are too few to diagnose, {} or more are needed{}",
                                      frames.frames(), least, notes.grid ? " with sites" : ""));
  return Diagnoser(notes, frames, darks, options).run();
}

}  // namespace atomcam
