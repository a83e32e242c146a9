#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>
#include <optional>

#include "base/error.hpp"
#include "diagnosis/contenders.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/gap_closed.hpp"
#include "diagnosis/model.hpp"
#include "diagnosis/search.hpp"
#include "diagnosis/sentence.hpp"
#include "diagnosis/where.hpp"

namespace atomcam {
namespace {

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
  Diagnoser(const Notes& notes, const ChosenFrames& frames, const ChosenFrames* darks,
            const DiagnosisOptions& options)
      : notes_(notes), frames_(frames), darks_(darks), options_(options) {
    result_.frames = frames.choice();
    if (darks) result_.dark_frames = darks->choice();
  }

  Diagnosis run() {
    const auto start = std::chrono::steady_clock::now();
    prepare();
    judge_plain();
    if (result_.p_gap < gap_level && !options_.where_only) explain();
    conclude();
    result_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return std::move(result_);
  }

 private:
  /// Never back: nobody knows beforehand how much will be tried, and stacks are simulated side by side.
  void tell(std::string_view step, double done) {
    if (!options_.progress) return;
    const std::scoped_lock lock(progress_mutex_);
    furthest_ = std::max(furthest_, done);
    options_.progress(step, furthest_);
  }

  void prepare() {
    CalibrationInput input;
    input.progress = [&](std::string_view step, double done) { tell(step, 0.03 * done); };
    input.notes = notes_;
    input.frames = &frames_;
    input.darks = darks_;
    input.threads = options_.threads;
    std::optional<KeptResults> fits;  // which depend on nothing else
    if (!options_.cache.empty()) input.kept = &fits.emplace(options_.cache, "");
    options_.beside.add_to(input);
    result_.calibration = calibrate(input);
    plan_.model = result_.calibration.model;
    plan_.frames = result_.frames;
    plan_.dark_frames = result_.dark_frames;
    plan_.split = split_of(plan_.frames.count(), options_.block);
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
                        write_lab(result_.calibration.lab) +
                        fmt::format("{} of {}", plan_.split.block, plan_.frames.all()));
      plan_.kept = &*kept_;
    }
  }

  void judge_plain() {
    const double cost =
        static_cast<double>(plan_.frames.count()) * static_cast<double>(frames_.shape().pixels());
    const int stacks = cost > 3e7 ? 160 : 240;
    plain_ = plain_model(real_stack(), stacks, plan_,
                         stacks_done(progress_, "plain model", 0.04, 0.25, plain_centre_stacks + stacks));
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

  RealStack real_stack() const {
    RealStack real{&real_, &result_.calibration, &notes_};
    if (options_.beside.background) {
      real.background_frames = options_.beside.background->frames();
      real.background_exposure_s = options_.beside.background_exposure_s;
    }
    return real;
  }

  void explain() {
    Search search({plain_, real_stack(), frames_, darks_, plan_, declarations_, excluded(), progress_});
    if (std::optional<Found> found = search.run()) {
      result_.verdict = found->verdict;
      result_.effects = std::move(found->effects);
      // What explains a part leaves the frames as odd as they were.
      if (found->model.explains.empty()) result_.p_after = found->model.p_value;
      final_ = std::move(found->model);
      have_final_ = true;
    }
    scans_ = search.take_scans();
    result_.hypotheses = std::move(search.hypotheses);
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

  void conclude() {
    how_far();
    // A name is what frames confirm that it was not fitted to. A rare event may be in the other half only.
    if (have_final_ && !result_.gap.shows)
      result_.verdict = Verdict::ambiguous;
    else if (have_final_ && closes_too_little(result_.gap, final_, plain_))
      withdraw();
    tell_apart();
    if (!options_.where_only) ask_others();
    result_.where = ranked_differences(declarations_, plain_.z, plain_.standard->tolerated(plain_.z),
                                       have_final_ ? final_.z : plain_.z, plain_.standard->own());
    result_.plain_lab = plain_.fitted_lab();
    result_.lab = have_final_ ? final_.fitted_lab() : plain_.fitted_lab();
    for (Lab* lab : {&result_.plain_lab, &result_.lab}) share_gain(*lab);
    if (result_.verdict == Verdict::no_gap && result_.p_gap < gap_level)
      result_.verdict = Verdict::unexplained;
    if (result_.verdict == Verdict::unexplained)
      result_.unexplained = unexplained_of(declarations_, plain_.z, result_.hypotheses);
    else if (result_.verdict == Verdict::partly_explained)
      result_.unexplained = unexplained_of(declarations_, final_.z);
    result_.next_measurement = next_measurements(result_, darks_ != nullptr);
    result_.sentence = sentence_of(result_);
    if (kept_) kept_->trim();
    tell("done", 1);
  }

  const Notes& notes_;
  const ChosenFrames& frames_;
  const ChosenFrames* darks_;
  const DiagnosisOptions& options_;
  std::mutex progress_mutex_;
  double furthest_ = 0;
  const DiagnosisProgress progress_ = [this](std::string_view step, double done) { tell(step, done); };
  Diagnosis result_;
  StackPlan plan_;
  std::optional<KeptResults> kept_;
  std::vector<StatisticDeclaration> declarations_;
  BatteryValues real_;
  Model plain_, final_;
  std::vector<Scan> scans_;
  bool have_final_ = false;
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
  const ChosenFrames light(frames, options.all_frames);
  std::optional<ChosenFrames> closed;
  if (darks) closed.emplace(*darks, options.all_frames);
  return Diagnoser(notes, light, closed ? &*closed : nullptr, options).run();
}

}  // namespace atomcam
