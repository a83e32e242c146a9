#pragma once
// A first look at every effect: some tens of stacks over its whole range, an emulator through them, and the
// parameters at which it comes closest to the real stack.

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "diagnosis/emulator.hpp"
#include "diagnosis/evidence.hpp"
#include "diagnosis/model.hpp"

namespace atomcam {

/// Two ways to look at a stack: with calibration held near the frames' own, and after a calibration that may
/// go as far as it takes. What calibration takes an effect for in part is only seen the second way, what it
/// could swallow far from the straight lines only the first.
inline constexpr std::size_t scan_views = 2;
using ScanViews = std::array<Eigen::VectorXd, scan_views>;  // compressed z
ScanViews views_of(const Standard& standard, const Eigen::VectorXd& statistics);

struct ScanView {
  Eigen::MatrixXd values;  // [stack, statistic] compressed z under the model before
  std::unique_ptr<Emulator> emulator;
  Eigen::VectorXd miss;         // squared distance of each stack from the real one
  Eigen::VectorXd best, width;  // coordinates
  Eigen::VectorXd usual;        // the likeliest strength of the effect in its usual form
  Eigen::VectorXd usual_sizes;  // the likeliest place where sizes spread as usual; empty: none do
  Eigen::VectorXd predicted;    // compressed z at the best parameters
  double log_likelihood = 0;    // relative to that of the model before: the evidence for the effect
  double share = 0;             // of the misfit of the model before that it takes away
};

struct Scan {
  const EffectDeclaration* effect = nullptr;
  std::vector<Uncertain> open;  // the effect's parameters
  Eigen::MatrixXd draws;        // [stack, parameter] of the effect
  std::array<ScanView, scan_views> view;
  std::size_t clearest() const { return view[1].log_likelihood > view[0].log_likelihood ? 1 : 0; }
  const ScanView& best() const { return view[clearest()]; }
};

/// Effects that make sense on this camera and are not excluded, nor in the model already.
std::vector<const EffectDeclaration*> candidates(const Model& before,
                                                 const std::vector<std::string>& excluded);

/// Adds `stacks` stacks of the effect on top of `before` (at its centres): over the whole prior at first,
/// about the best parameters later.
void explore(Scan& scan, const Model& before, int stacks, const StackPlan& plan, std::uint64_t first,
             const std::function<void(int)>& progress = {});

/// Emulators through the stacks of each scan, parameters that fit best, and the evidence. `correlation`: of
/// the model before.
void match(std::span<Scan> scans, const Correlation& correlation, const ScanViews& real, int threads);

/// How much of an effect's fingerprint (compressed z) another one could pass for with the parameters that
/// suit it best: 1 minus the square of what is left, over the square of all. As seen in `view`.
double imitated(const Eigen::VectorXd& fingerprint, const Scan& by, std::size_t view);

/// What an effect takes away of the deviations that `mask` is 1 for: the part of their squares, and with
/// which parameters.
struct PartMatch {
  double share = 0;
  Eigen::VectorXd best;
};
PartMatch match_part(const Scan& scan, const Eigen::VectorXd& mask, const ScanViews& real);

/// What an effect with these parameters leaves of the deviations, taken to add up.
ScanViews less(const ScanViews& real, const Scan& scan, const Eigen::VectorXd& at);

/// Two effects at once: their deviations taken to add up.
struct PairMatch {
  std::size_t first = 0, second = 0;  // scans
  Eigen::VectorXd best_first, best_second;
  double gain = 0;   // in logarithmic likelihood over the better of the two alone
  double alone = 0;  // of the better one over neither
};

/// All pairs of one of the first `leaders` scans with any other, the most promising first. No correlations
/// between statistics: a quick look, without simulation.
std::vector<PairMatch> match_pairs(const std::vector<Scan>& scans, std::size_t leaders, const ScanViews& real,
                                   int threads);

/// An effect on top of a model that is judged already: deviations taken to add up.
struct AddedMatch {
  std::size_t scan = 0;
  Eigen::VectorXd best;
  double gain = 0;  // in logarithmic likelihood over the model without it
};

/// Every scan's effect that `model` does not have on top of it, the most promising first. `standard`: of the
/// model that the scans were made on. A quick look, as match_pairs().
std::vector<AddedMatch> match_added(const std::vector<Scan>& scans, const Model& model,
                                    const Standard& standard, const ScanViews& real, int threads);

}  // namespace atomcam
