#pragma once
// Real against simulated: where they differ, which effect that the model lacks causes it, how far the gap
// shrinks once it is added.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "analysis/battery.hpp"
#include "calibration/calibrate.hpp"
#include "diagnosis/character.hpp"
#include "diagnosis/chosen_frames.hpp"
#include "diagnosis/progress.hpp"
#include "diagnosis/second_opinions.hpp"

namespace atomcam {

enum class Verdict { no_gap, explained, partly_explained, unexplained, ambiguous };
std::string_view name_of(Verdict verdict);

/// One entry of the table of differences, the most significant first.
struct Difference {
  std::string stage;  // where in the chain this kind of difference arises
  std::string statistic, observable, axis, place;
  double z = 0;        // plain model, all frames
  double q = 1;        // false discovery rate over the whole battery
  double z_after = 0;  // with the found effects
};

struct FoundParameter {
  std::string name, unit;
  double value = 0;
  double low = 0, high = 0;  // one standard error to either side, on the scale on which errors are even
  double error() const { return 0.5 * (high - low); }
};
struct FoundEffect {
  std::string name, stage;
  std::vector<FoundParameter> parameters;
  double probability = 0;
  std::vector<std::string> confusable_with;
};

/// A hypothesis that was tried, for the ranking.
struct Hypothesis {
  std::vector<std::string> effects;
  double log_evidence = 0;  // against the plain model, from the scan
  double share = 0;         // of the plain model's misfit that the scan's best would take away
  double p_value = -1;      // goodness of fit once fitted by simulation; -1: not fitted
  double closed = 0;        // of the gap, once fitted
  double imitates = -1;     // part of the found effect's fingerprint it could pass for; -1: not asked
  std::string why_not;
  bool not_seen = false;  // the frames have nothing where it would show: nor is it what comes near
};

/// The gap once this effect is added to those before it, at the values that all of them were fitted to.
struct GapStep {
  std::string effect;
  double gap = 0;
};
/// The gap in one observable alone.
struct ObservableGap {
  std::string observable;
  double before = 0, after = 0, floor = 0, closed = 0;
};
struct GapClosed {
  std::string metric = "mean square of the 12 largest deviations of the battery, held-out frames";
  double before = 0, after = 0, floor = 0, closed = 0;
  /// More before than 95 % of the plain model's stacks: half of the frames may be too few for what all of
  /// them have.
  bool shows = true;
  double closed_low = 0, closed_high = 0;
  std::vector<ObservableGap> by_observable;  // the widest gap first
  /// Where the effects are named for what they close in these observables alone: that, as `closed` is of all.
  std::vector<std::string> explains;
  double part_closed = 0, part_closed_low = 0, part_closed_high = 0;
  std::vector<GapStep> steps;
  SecondOpinions second_opinions;
};

struct Unexplained {
  bool present = false;
  std::string stage;
  Character character;
  std::string looks_like;  // the character and the most telling differences, in words
};

/// Stacks beside the frames and the darks; calibration takes what they tell.
struct SideStacks {
  const FrameSequence* background = nullptr;  // shutter open, no atoms
  double background_exposure_s = 0;           // 0: that of the frames
  std::vector<CalibrationInput::Flats> flats;

  void add_to(CalibrationInput& input) const {
    input.background = background;
    input.background_exposure_s = background_exposure_s;
    input.flats = flats;
  }
};

struct DiagnosisOptions {
  std::vector<std::string> exclude;  // effects that are not looked for
  std::vector<std::string> include;  // if not empty: only these
  SideStacks beside;
  std::uint64_t seed = 1;
  int threads = 1;
  bool where_only = false;
  bool all_frames = false;  // also of a stack so large that a part is looked at, however long it takes
  std::size_t block = 10;   // frames of a part
  /// Where results of simulated stacks are kept for the next diagnosis of the same data; empty: nowhere.
  std::filesystem::path cache;
  /// What is under way.
  DiagnosisProgress progress;
  /// Called after every simulated stack, from any thread; what it or `progress` throws ends the work.
  std::function<void()> check_in;
};

struct Diagnosis {
  bool against = false;                             // another stack was in the place of the simulation
  FrameChoice frames, dark_frames, against_frames;  // that were looked at
  /// Of the stack in this role ("frames", "darks", "against"); none for others.
  FrameChoice looked_at(std::string_view role) const {
    return role == "frames" ? frames : role == "darks" ? dark_frames : role == "against" ? against_frames : 0;
  }
  Verdict verdict = Verdict::no_gap;
  std::string sentence;
  std::vector<FoundEffect> effects;
  std::vector<Difference> where;
  GapClosed gap;
  Unexplained unexplained;
  std::vector<std::string> next_measurement;
  std::vector<Hypothesis> hypotheses;
  double p_gap = 1;    // of the plain model
  double p_after = 1;  // with the found effects
  Calibration calibration;
  Lab plain_lab;  // calibrated, without effects, as the held-out test used it
  Lab lab;        // the same with the found effects
  double seconds = 0;
};

/// Throws Error for stacks that cannot be judged (too short, wrong shape, no light where the notes list
/// sites).
Diagnosis diagnose(const Notes& notes, const FrameSequence& frames, const FrameSequence* darks,
                   const DiagnosisOptions& options);

}  // namespace atomcam
