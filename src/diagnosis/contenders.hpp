#pragma once
// Models that may be the explanation, fitted side by side: some rounds for all of them, more for those that
// come near, and the nearest are judged.

#include <map>
#include <string>
#include <vector>

#include "diagnosis/fit.hpp"
#include "diagnosis/model.hpp"
#include "diagnosis/progress.hpp"

namespace atomcam {

inline constexpr double like_own = 1.1;       // distance of a fit about as near as the model's own stacks
inline constexpr double far_away = 1.4;       // nothing at this distance has ever closed two thirds of a gap
inline constexpr double reject_level = 0.01;  // p-value: a fitted model below it is not the explanation

/// A model that may be the explanation, from one start.
struct Contender {
  std::string name;  // of the model and the start: seeds
  Model model;
  double evidence = 0;   // how promising it looked, logarithm
  bool lets_go = false;  // of the parameters that are held, once the others are fitted
};

/// Where the fits of each combination of effects came nearest: all open parameters.
using Ends = std::map<std::vector<std::string>, std::vector<Uncertain>>;

/// What is known before, and what is asked.
struct Before {
  // Distances of the nearest models that have been judged.
  double fewer = 1e300;    // of a simpler one: what is not nearer is let go after the first rounds
  double as_many = 1e300;  // with as many effects: what is far behind it is not judged
  std::vector<std::string> part = {};  // observables whose gap is to be closed; empty: all of it
};

/// The effects of a model, as people read them.
std::string title(const Model& model);

/// The nearest of the contenders, judged; of each combination of effects the best start. None where all of
/// them are farther away than those judged before allow. Adds to `ends`.
std::vector<Contender> fitted_and_judged(std::vector<Contender> contenders, const FitGround& ground,
                                         const std::vector<StatisticDeclaration>& battery,
                                         const Before& before, const StackPlan& plan,
                                         const DiagnosisProgress& progress, Ends& ends);

}  // namespace atomcam
