#pragma once
// The declaration of one physical parameter. Reader, range check, command line, GenICam feature, documents
// and fit bounds follow from it; nothing about a parameter is written twice.

#include <string>
#include <vector>

namespace atomcam {

enum class ParameterScale { linear, logarithmic };

struct ParameterDeclaration {
  std::string key;     // with the unit as its last word where it has one: "amplitude_px"
  std::string unit;    // "px", "e", "1" for a bare ratio
  double minimum = 0;  // inclusive
  double maximum = 1;  // inclusive
  double default_value = 0;
  ParameterScale scale = ParameterScale::linear;
  std::string meaning;  // one sentence
  bool integer = false;
};

/// Values in the order of their declarations.
using ParameterValues = std::vector<double>;

}  // namespace atomcam
