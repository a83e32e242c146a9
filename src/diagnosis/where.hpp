#pragma once
// Where frames differ from a model: the list of differences.

#include <vector>

#include <Eigen/Dense>
#include "diagnosis/diagnosis.hpp"

namespace atomcam {

/// The strongest first, with the false discovery rate over the battery. `own`: deviations of stacks that do
/// not differ, a row each, whose tails count; `tolerated`: z where the model is allowed to be wrong by
/// something, of which the false discovery rate is.
std::vector<Difference> ranked_differences(const std::vector<StatisticDeclaration>& battery,
                                           const Eigen::VectorXd& z, const Eigen::VectorXd& tolerated,
                                           const Eigen::VectorXd& z_after, const Eigen::MatrixXd& own);

}  // namespace atomcam
