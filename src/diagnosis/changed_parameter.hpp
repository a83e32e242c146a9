#pragma once
// Which parameter of the plain model, changed alone, makes a difference like this one.

#include <Eigen/Dense>
#include <string>

#include "diagnosis/evidence.hpp"
#include "diagnosis/population.hpp"

namespace atomcam {

struct ChangedParameter {
  std::string words;  // "atom_light were 12 % higher"; empty: none
  std::string stage;
  double closed = 0;  // of what the difference is more than chance
};

/// `z`: the difference, in `units` of the statistics; `own`: of stacks that do not differ, a row each.
ChangedParameter changed_parameter(const Population& plain, const std::vector<Uncertain>& open,
                                   const Eigen::VectorXd& z, const Eigen::VectorXd& units,
                                   const Eigen::MatrixXd& own);

}  // namespace atomcam
