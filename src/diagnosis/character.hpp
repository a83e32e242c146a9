#pragma once
// What kind of thing makes the differences, as far as the statistics tell that see them.

#include <string>
#include <vector>

#include <Eigen/Dense>
#include "analysis/battery.hpp"

namespace atomcam {

/// Every word may be missing: the differences then do not tell.
struct Character {
  std::string axis;    // along which most of it lies, of StatisticDeclaration
  std::string change;  // "static", "changing", or "static and changing"
  std::string action;  // "additive" (with the shutter closed, or where little light falls), "multiplicative"
  std::string period;  // "2 rows", "4 columns", "2 frames"
};

/// z: deviations of the battery's statistics, in standard deviations.
Character character_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z);

/// "static, multiplicative, along space, period 2 rows"; empty where nothing is known.
std::string in_words(const Character& character);

}  // namespace atomcam
