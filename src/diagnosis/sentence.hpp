#pragma once
// A diagnosis in words: the sentence, what is not explained, what to measure next.

#include <string>
#include <vector>

#include <Eigen/Dense>
#include "diagnosis/diagnosis.hpp"

namespace atomcam {

/// What is not explained: its stage, its character, the most telling differences.
Unexplained unexplained_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                           const std::vector<Hypothesis>& hypotheses = {});

std::vector<std::string> next_measurements(const Diagnosis& diagnosis, bool has_darks);
std::string sentence_of(const Diagnosis& diagnosis);

}  // namespace atomcam
