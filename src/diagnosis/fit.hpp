#pragma once
// Finding the parameters at which a model comes closest to the real stack: simulate about a place, move by a
// Gauss-Newton step within a region of trust, go back where that made it worse.

#include "diagnosis/model.hpp"

namespace atomcam {

/// What a fit starts from, common to all hypotheses.
struct FitGround {
  const Model* plain = nullptr;  // judged: gives the statistics' noise and how calibration's parameters act
  RealStack real;
};

/// How far the real stack is from the plain model itself, as fit() says it of a model that explains these
/// observables.
double plain_distance(const FitGround& ground, const StackPlan& plan,
                      const std::vector<std::string>& explains = {});

/// Moves the model's centres, and the widths of its effects' parameters to about their errors. Every round
/// simulates some stacks about the centre; calibration follows the effects (recalibrate). At most `rounds`,
/// fewer where it leads no nearer than model.distance. A fit before this one is gone on with: model.distance
/// and model.nearest are its best place, to which a step that led astray returns.
void fit(Model& model, const FitGround& ground, int rounds, const StackPlan& plan, std::uint64_t first);

}  // namespace atomcam
