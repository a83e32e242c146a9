#pragma once
// How far a model is from the frames by measures that no fit has seen, on held-out frames: not to be
// explained away by a fit that learned to please its own battery.

#include <cstdint>
#include <string>
#include <vector>

#include "analysis/battery.hpp"
#include "analysis/frame_sequence.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

struct Model;
struct StackPlan;

/// NaN: does not exist.
struct Figure {
  double value = 0, error = 0;  // standard error
};

/// One distance between the frames and a model. `floor`: of stacks simulated from the model itself (from labs
/// that differ from it as a calibration may), mean and scatter; of the model with the effects where there is
/// one. `before`, `after`: of the frames from the plain model and from the one with the effects; errors from
/// the scatter between parts of the frames. What a single stack of a right model gives scatters by the
/// floor's error: only what is farther above the floor is a difference.
struct SecondOpinion {
  std::string metric, sees, blind_to;
  Figure before, after, floor;
  double closed = 0;  // 1 - (after - floor) / (before - floor); NaN unless before is 3 errors above the floor
};

/// What an atom detector says on the frames and on each model's. Without truth a fidelity can only be
/// estimated: by two normal peaks fitted to the scores. The same is done to simulated frames, where the truth
/// is known besides. Errors: scatter between simulated stacks.
struct DetectorOpinion {
  std::string detector;  // "threshold", "matched_filter"
  struct OfFrames {
    Figure fidelity;    // by the peaks
    Figure separation;  // of the peaks, in their widths
    Figure truly;       // part of the sites called rightly at the threshold between the peaks
  };
  OfFrames real, before, after;  // `real.truly` is NaN
};

struct SecondOpinions {
  std::vector<SecondOpinion> metrics;
  std::vector<DetectorOpinion> detectors;  // empty: no sites
  std::size_t frames = 0;                  // held-out frames that were looked at
};

/// A model at the values that were fitted, and labs that differ from it by the errors of such fits: as far
/// from it as it may be from the truth.
struct OpinionModel {
  Lab lab;
  std::vector<Lab> alike;
};
/// Open parameters are those that fit the real stack's fitting part best; with `as_calibrated`, those that
/// calibration gave: what fits a stack best in which much is different moves the parameters to please that.
OpinionModel opinion_model(const Model& model, const BatteryValues& real, bool as_calibrated = false);

/// `fixed`: with the found effects; null: none were found. Stacks are numbered from `first` on, both models'
/// alike: what differs is the models. Looks at every frame once, and at fewer of large ones.
SecondOpinions second_opinions(const FrameSequence& real, const StackPlan& plan, const OpinionModel& plain,
                               const OpinionModel* fixed, std::uint64_t first);

}  // namespace atomcam
