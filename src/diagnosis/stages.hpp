#pragma once
// From differences of the battery to words: which stage of the chain, what it looks like, what to measure
// next.

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

/// The strongest first, with the false discovery rate over the battery. `own`: deviations of stacks that do
/// not differ, a row each, whose tails count.
std::vector<Difference> ranked_differences(const std::vector<StatisticDeclaration>& battery,
                                           const Eigen::VectorXd& z, const Eigen::VectorXd& z_after,
                                           const Eigen::MatrixXd& own);

/// What is not explained: its stage, its character, the most telling differences.
Unexplained unexplained_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                           const std::vector<Hypothesis>& hypotheses = {});

std::vector<std::string> next_measurements(const Diagnosis& diagnosis, bool has_darks);
std::string sentence_of(const Diagnosis& diagnosis);

}  // namespace atomcam
