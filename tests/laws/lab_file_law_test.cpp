// Every parameter of every effect survives a lab file, and a value that its declaration does not allow does
// not.

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "laws/stacks.hpp"

namespace atomcam::laws {
namespace {

class EveryEffectsKeys : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryEffectsKeys, testing::ValuesIn(cases()),
                         [](const auto& one) { return case_name(one.param); });

/// Odd values within the ranges, other ones for each round.
ParameterValues odd_values(const EffectDeclaration& effect, int round) {
  ParameterValues values;
  for (const ParameterDeclaration& parameter : effect.parameters) {
    const double share =
        std::fmod(0.1234567890123 * (1 + round) + 0.31 * static_cast<double>(values.size()), 1.0);
    double value = parameter.minimum + share * (parameter.maximum - parameter.minimum);
    if (round == 2) value = parameter.maximum;
    if (parameter.integer) value = std::round(value);
    values.push_back(value);
  }
  return values;
}

TEST_P(EveryEffectsKeys, SurviveALabFile) {
  const auto& [effect, kind] = GetParam();
  for (int round = 0; round < 3; ++round) {
    Lab lab = preset(kind == CameraKind::emccd ? "ixon-ultra-897" : "orca-quest");
    lab.effects[effect->name] = odd_values(*effect, round);
    EXPECT_EQ(parse_lab(write_lab(lab), "toml").effects, lab.effects) << write_lab(lab);
    EXPECT_EQ(parse_lab(write_lab(lab, true), "commented toml").effects, lab.effects);
    EXPECT_EQ(parse_lab(write_lab_json(lab), "json", true).effects, lab.effects) << write_lab_json(lab);
  }
}

TEST_P(EveryEffectsKeys, AreCheckedAgainstTheirRange) {
  const auto& [effect, kind] = GetParam();
  Lab lab = preset(kind == CameraKind::emccd ? "ixon-ultra-897" : "orca-quest");
  for (const ParameterDeclaration& parameter : effect->parameters) {
    const std::string key = "effects." + effect->name + "." + parameter.key;
    for (const double wrong : {parameter.minimum - 1, parameter.maximum * 2 + 1}) {
      try {
        set_parameter(lab, key, wrong);
        ADD_FAILURE() << key << " takes " << wrong;
      } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find(parameter.key), std::string::npos) << error.what();
      }
    }
    set_parameter(lab, key, parameter.maximum);
    EXPECT_EQ(lab.effects.at(effect->name)[static_cast<std::size_t>(&parameter - effect->parameters.data())],
              parameter.maximum);
  }
}

}  // namespace
}  // namespace atomcam::laws
