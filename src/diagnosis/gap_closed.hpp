#pragma once
// How far the gap between real and simulated shrinks with the effects that were found.

#include "diagnosis/diagnosis.hpp"
#include "diagnosis/model.hpp"

namespace atomcam {

/// 1 for the statistics of these observables, 0 for the others; of no observable: 1 for all.
Eigen::VectorXd only_of(const std::vector<std::string>& observables,
                        const std::vector<StatisticDeclaration>& battery);

/// Deviations of a model in units of the larger of two models' deviations; 0 where one of them has none.
Eigen::VectorXd in_larger_units(const Standard& model, const Standard& other);

inline constexpr double least_to_pass = 0.6;  // closed, for a model that the frames are not odd under

/// Closed fraction over all frames of the gap in what a judged model is to explain. Both models count in
/// units of the larger of their deviations: nothing is closed by a model that only scatters widely. Some
/// effects come out differently every time (a few cosmic rays, a walk of the bias), and hide most of a gap
/// that way. If the frames are hardly odd under such a model and much likelier than under the plain one,
/// though its scatter counts against it, each counts in its own units. No more is closed than by what
/// the model's own stacks can look like: scatter that goes elsewhere explains nothing; but a gap that stands
/// out by far in the larger units as well is not hidden by scatter, and counts as closed there.
double closed_by(const Model& model, const Model& plain, const std::vector<StatisticDeclaration>& battery);
/// The same of the gap in these observables alone (empty: all).
double closed_by(const Model& model, const Model& plain, const std::vector<StatisticDeclaration>& battery,
                 const std::vector<std::string>& observables);

/// The same, each model counting in its own units whatever the evidence.
double closed_in_own_units(const Model& model, const Model& plain,
                           const std::vector<StatisticDeclaration>& battery);

/// Whether the frames are hardly odd under the model and much likelier than under the plain one, though its
/// scatter counts against it.
bool much_likelier(const Model& model, const Model& plain);

/// Whether the frames differ from the judged model only in directions in which its own stacks scatter
/// together: what is left without these is as little as the plain model leaves of its own, or as most of its
/// own stacks leave to the others.
bool differs_as_own_stacks(const Model& model, const Model& plain,
                           const std::vector<StatisticDeclaration>& battery);

/// The model's open parameters (coordinates) as the first of the interleaved parts has them.
/// `estimator`: the model's from that part.
Eigen::VectorXd fitted_to_first_part(const Model& model, const BatteryValues& real);
Eigen::VectorXd fitted_to_first_part(const Model& model, const Standard& estimator,
                                     const BatteryValues& real);

/// The gap on the held-out part with the effects as fitted to the first, calibration being free to follow;
/// without `steps` and `second_opinions`.
GapClosed gap_closed(const Model& found, const Model& plain, const BatteryValues& real,
                     const std::vector<StatisticDeclaration>& battery);
/// The same where nothing was found.
GapClosed gap_left(const Model& plain, const BatteryValues& real);

}  // namespace atomcam
