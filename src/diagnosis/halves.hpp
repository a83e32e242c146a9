#pragma once
// How much parts of one stack differ: what a camera does that the plain model does not know, as long as it
// does it all the time, makes halves of a stack differ more than halves of a simulated one.

#include <Eigen/Dense>

#include "diagnosis/population.hpp"

namespace atomcam {

/// Frames of a block, which stays together: sixteen blocks or more to a stack.
std::size_t block_of_halves(std::size_t frames);

/// Differences of the battery between halves of the stack, for `count` random choices of blocks: a row each.
Eigen::MatrixXd differences_of_halves(const FrameSequence& frames, const StackPlan& plan, int count);

/// Scatter of each column about its median, from quantiles; 0 where nothing scatters.
Eigen::VectorXd scatter_of(const Eigen::MatrixXd& differences);

}  // namespace atomcam
