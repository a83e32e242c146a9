#pragma once
// A hypothesis about a stack: the plain model with some effects on, judged by really simulating it.

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/evidence.hpp"
#include "diagnosis/population.hpp"
#include "diagnosis/standard.hpp"

namespace atomcam {

struct Model {
  std::vector<std::string> effects;  // in the order they were found; empty: the plain model
  Lab lab;                           // to which the open parameters are applied
  std::vector<Uncertain> open;       // those of the calibration first, then the effects'
  Eigen::Index first_effect_parameter = 0;
  /// Observables that it is to explain, whatever the plain model misses of the others; empty: all.
  std::vector<std::string> explains;
  /// What open parameters that its stacks do not vary leave uncertain of each statistic (1 sigma, in the
  /// statistic's unit); empty: nothing.
  Eigen::VectorXd undrawn;
  Population population;
  Population wider;  // to estimate from, where the draws of `population` are too narrow for that; else empty
  std::unique_ptr<Standard> standard;
  std::unique_ptr<Correlation> correlation;  // of its own stacks' statistics
  std::unique_ptr<OmnibusTest> test;
  Eigen::VectorXd estimate, error;  // open parameters for the real stack, coordinates
  Eigen::VectorXd response;         // how much of a draw's way from the middle such an estimate goes
  Eigen::VectorXd z;                // the real stack's residuals
  Eigen::MatrixXd from_plain;       // its own stacks' residuals under the plain model, a row each
  double p_value = 1;               // of the real stack, the model's discrepancy granted
  double oddest = 1;                // smallest p-value of the places tried that are as likely as this one
  double gap = 0;                   // of the real stack
  double floor = 1;                 // median gap of its own stacks
  double distance = 1e300;          // of the real stack from the best place that fits found
  /// Likewise, twice the negative log likelihood a statistic there, up to a constant: what scatters widely is
  /// near to anything. It tells places of one model apart.
  double unlikeliness = 1e300;
  std::vector<Uncertain> nearest;   // the open parameters there
  double log_likelihood = 0;        // of the real stack's battery
  double usual_log_likelihood = 0;  // mean of those of its own stacks

  /// Whether this is one of its effects.
  bool has(std::string_view effect) const;
  /// The same, as if not judged.
  Model unjudged() const;
  /// The lab at the fitted values.
  Lab fitted_lab() const;
  /// The lab with the open parameters at these coordinates.
  Lab lab_at(const Eigen::VectorXd& coordinates) const;
  /// How wrong it may be about each statistic, with what is `undrawn`.
  Eigen::VectorXd with_undrawn(Eigen::VectorXd discrepancy) const;
  /// What the model's open parameters are estimated with, from a part of the real stack.
  Standard estimator(Part part) const;
  /// The model with only the first `count` of its effects, fixed at these coordinates.
  Model with_first_effects(std::size_t count, const Eigen::VectorXd& coordinates) const;
};

/// No objective is described by fifteen Zernike terms to the precision of some hundred frames: how far the
/// statistics of the point-spread function, and of what its wings do to the frame, may be off for that reason
/// (in the statistics' units): 1.5 deviations at 300 frames, 0.5 of what compares the sites' images with each
/// other, as all of them have the same detail.
Eigen::VectorXd optical_detail(const Eigen::VectorXd& deviation, const StackPlan& plan);

/// An effect's model in the catalogue and the effect in somebody's camera are not the same to all digits. By
/// how much a model with effects may be wrong about each statistic of the real stack (1 sigma): 4 % of what
/// the plain model misses of it, and 2 % of the largest that it misses in the same observable, in units of
/// each statistic's own deviation. `explains`: of all other observables (if any are named) it may miss all
/// that the plain model misses.
Eigen::VectorXd allowed_discrepancy(const Model& plain, const BatteryValues& real, const StackPlan& plan,
                                    const std::vector<std::string>& explains = {});

/// Estimates of the effects' parameters (from `first` on) that are known worse than by the draws they are
/// learned from: not led beyond these.
Standard::Estimate within_draws(Standard::Estimate estimate, const std::vector<Uncertain>& open,
                                Eigen::Index first);

/// Of stacks' batteries (a row each) from what a model expects, with what it may be wrong by tolerated: a
/// column each.
Eigen::MatrixXd compressed_deviations(const Standard& standard, const Eigen::MatrixXd& statistics);

/// Logarithmic likelihoods of stacks' batteries (a row each) under a judged model; and of its own stacks,
/// each under what the others say of the model (as many folds as in its standard).
Eigen::VectorXd log_likelihoods(const Model& model, const Eigen::MatrixXd& statistics);
Eigen::VectorXd own_log_likelihoods(const Model& model);

/// Its stacks do not vary the shared parameters, as making them would take too long: what these leave
/// uncertain follows from the plain model's slopes.
void leave_undrawn(Model& model, const Model& plain);

/// Residuals of the model's own stacks with its discrepancy granted, a row each.
Eigen::MatrixXd tolerated_own(const Model& model);

/// Simulates `stacks` of the model and judges the real one by them. `plain`: the judged plain model, for the
/// discrepancy that a model with effects is allowed; none of it without.
void judge(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first,
           const Model* plain = nullptr, const std::function<void(int)>& progress = {});

enum class Beyond { clearly, at_all };
/// What the frames want of one of the model's effects that it cannot be: a parameter beside its strength that
/// is estimated beyond its maximum, clearly or at all (noise that forgets so slowly that it is a drift); else
/// empty.
std::string beyond_its_law(const Model& model, Beyond by = Beyond::clearly);

/// What the real stack is, besides its battery: how it was calibrated, so that simulated ones can be alike.
struct RealStack {
  const BatteryValues* values = nullptr;
  const Calibration* calibration = nullptr;
  const Notes* notes = nullptr;
  std::size_t background_frames = 0;  // without atoms; 0: calibrated without them
  double background_exposure_s = 0;   // 0: that of the frames
};

/// Puts the open parameters of these names about these values, within their bounds.
void start_at(Model& model, const std::map<std::string, double>& values);

/// Moves the calibration's parameters so that simulated stacks of the model calibrate as the real one does:
/// what calibration absorbed of an effect is given back.
void recalibrate(Model& model, const RealStack& real, const StackPlan& plan, std::uint64_t first);

/// The plain model about a stack's calibration, judged: `stacks` simulated ones are its null. `progress` of
/// stacks out of `stacks` and plain_centre_stacks more.
inline constexpr int plain_centre_stacks = 80;
Model plain_model(const RealStack& real, int stacks, const StackPlan& plan,
                  const std::function<void(int)>& progress = {});

}  // namespace atomcam
