#pragma once
// Strengths of effects and their errors, from stacks that vary more than those a model is judged by.

#include "diagnosis/model.hpp"

namespace atomcam {

/// Optics may make up for a part of an effect, and an effect for what they are wrong by: how far, a
/// calibration of frames without effects does not tell. Estimates the open parameters anew from `stacks` more
/// with wider draws of the optics (`wider`); whether that leads clearly away from where the model is.
bool estimate_with_wider_optics(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan,
                                std::uint64_t first);

/// The stacks of a model on the way to this one tell of its parameters, too.
void learn_from(Model& model, const Model& before);
/// The other's estimate, from more such stacks.
void take_estimate(Model& model, const Model& other);

/// Draws that are narrow beside the error of an estimate hardly show how the statistics follow a parameter.
/// `stacks` more, with wider draws of the effects' parameters that were so (and of the optics), to estimate
/// them from (`wider`).
void widen(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first);

}  // namespace atomcam
