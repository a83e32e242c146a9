#pragma once
// A hypothesis about a stack - the plain model with some effects on - fitted by really simulating it: draw,
// simulate, measure, move the centres to where the real stack says, again.

#include <functional>
#include <memory>
#include <string>
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
  Population population;
  std::unique_ptr<Standard> standard;
  std::unique_ptr<OmnibusTest> test;
  Eigen::VectorXd estimate, error;  // open parameters for the real stack, coordinates
  Eigen::VectorXd z;                // the real stack's residuals
  double p_value = 1;
  double gap = 0;             // of the real stack
  double floor = 1;           // median gap of its own stacks
  double log_likelihood = 0;  // of the real stack's battery

  /// The lab at the fitted values.
  Lab fitted_lab() const;
};

/// Simulates `stacks` of the model and judges the real one by them.
void judge(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first,
           const Eigen::MatrixXd& directions = {}, const std::function<void(int)>& progress = {});

/// What the real stack is, besides its battery: how it was calibrated, so that simulated ones can be alike.
struct RealStack {
  const BatteryValues* values = nullptr;
  const Calibration* calibration = nullptr;
  const Notes* notes = nullptr;
};

/// Moves the calibration's parameters so that simulated stacks of the model calibrate as the real one does:
/// what calibration absorbed of an effect is given back.
void recalibrate(Model& model, const RealStack& real, const StackPlan& plan, std::uint64_t first);

/// Some rounds of small populations, each about the last one's estimate, then judge().
void fit_and_judge(Model& model, const RealStack& real, int rounds, int stacks, const StackPlan& plan,
                   std::uint64_t first, const std::function<void(int)>& progress = {});

}  // namespace atomcam
