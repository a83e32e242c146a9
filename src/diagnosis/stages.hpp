#pragma once
// Which stage of the chain differences of the battery speak for: the atoms, the optics, the sensor.

#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>
#include "diagnosis/diagnosis.hpp"

namespace atomcam {

/// Where differences of this observable usually arise; of dark frames: the sensor.
std::string stage_of_observable(std::string_view observable, bool darks);

/// The stage that the differences speak for; known effects that come close count too.
std::string stage_of_differences(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                                 const std::vector<Hypothesis>& hypotheses);

}  // namespace atomcam
