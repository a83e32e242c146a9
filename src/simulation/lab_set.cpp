#include "simulation/lab_set.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "base/error.hpp"
#include "simulation/lab_text_form.hpp"

namespace atomcam {
namespace {

std::vector<std::string> collect_keys(CameraKind kind) {
  std::vector<std::string> keys;
  for (const LabText& text : lab_texts(kind)) keys.push_back(text.key);
  for (const LabParameter& parameter : lab_parameters(kind)) keys.push_back(parameter.declaration.key);
  return keys;
}

/// "effects.row_noise" stands for its strength.
std::string strength_key(std::string_view key) {
  constexpr std::string_view prefix = "effects.";
  if (!key.starts_with(prefix)) return {};
  const EffectDeclaration* effect = find_effect(key.substr(prefix.size()));
  if (!effect || effect->parameters.empty()) return {};
  return std::string(key) + "." + effect->parameters[0].key;
}

std::string place_of(std::string_view place, std::string_view key) {
  return fmt::format("{}: {}", place, key);
}

/// The strength, the rest of an effect that was off being as declared.
void set_checked(Lab& lab, const LabParameter& parameter, double value, const std::string& place) {
  check_value(parameter.declaration, value, place);
  parameter.set(lab, value);
}

}  // namespace

std::string allowed_text(const ParameterDeclaration& declaration) {
  return fmt::format("{}{} to {}{}{}", declaration.integer ? "whole numbers from " : "",
                     number_text(declaration.minimum), number_text(declaration.maximum),
                     declaration.unit == "1" ? "" : " ", declaration.unit == "1" ? "" : declaration.unit);
}

void check_value(const ParameterDeclaration& declaration, double value, std::string_view place) {
  const bool inside = value >= declaration.minimum && value <= declaration.maximum;  // false for nan
  if (!inside || (declaration.integer && value != std::floor(value))) {
    throw Error(place, fmt::format("value {}; allowed {}", number_text(value), allowed_text(declaration)));
  }
}

const std::vector<std::string>& lab_keys(CameraKind kind) {
  static const std::vector<std::string> emccd = collect_keys(CameraKind::emccd);
  static const std::vector<std::string> qcmos = collect_keys(CameraKind::qcmos);
  return kind == CameraKind::emccd ? emccd : qcmos;
}

const LabParameter* find_scalar(CameraKind kind, std::string_view key) {
  const LabParameter* parameter = find_lab_parameter(kind, key);
  return parameter ? parameter : find_lab_parameter(kind, strength_key(key));
}

void throw_unknown_key(std::string_view place, std::string_view key, CameraKind kind) {
  constexpr std::size_t longest = 100;  // nearness of longer ones says nothing and costs much
  const std::string name = kind == CameraKind::emccd ? "an EMCCD" : "a qCMOS";
  const CameraKind other = kind == CameraKind::emccd ? CameraKind::qcmos : CameraKind::emccd;
  const auto& others = lab_keys(other);
  for (const std::string& known : others) {
    if (known == key || known.starts_with(fmt::format("{}.", key.substr(0, longest)))) {
      throw Error(place, fmt::format("{} does not exist on {}", in_quotes(key), name));
    }
  }
  if (key.size() > longest) throw Error(place, fmt::format("unknown key {}", in_quotes(key)));
  std::vector<std::string> known = lab_keys(kind);
  // The last word alone, in the wrong table: the whole key is meant.
  const std::string_view last = key.substr(key.rfind('.') + 1);
  const std::string ending = fmt::format(".{}", last);
  for (const std::string& candidate : known) {
    if (candidate.ends_with(ending)) {
      throw Error(place, fmt::format("unknown key {}; the nearest is '{}'", in_quotes(key), candidate));
    }
  }
  for (const EffectDeclaration& effect : effect_catalogue()) known.push_back("effects." + effect.name);
  throw Error(place,
              fmt::format("unknown key {}; the nearest is '{}'", in_quotes(key), nearest_word(key, known)));
}

void set_parameter(Lab& lab, std::string_view key, std::string_view value, std::string_view place) {
  for (const LabText& text : lab_texts(lab.kind())) {
    if (text.key == key) return text.set(lab, value, place_of(place, key));
  }
  const LabParameter* parameter = find_scalar(lab.kind(), key);
  if (!parameter) throw_unknown_key(place, key, lab.kind());
  std::optional<double> number = parse_number(value);
  if (parameter->boolean && value == "true") number = 1;
  if (parameter->boolean && value == "false") number = 0;
  if (!number) {
    throw Error(place_of(place, key),
                fmt::format("value {} is not a number; allowed {}", in_quotes(value),
                            parameter->boolean ? "true or false" : allowed_text(parameter->declaration)));
  }
  set_checked(lab, *parameter, *number, place_of(place, key));
}

void set_parameter(Lab& lab, std::string_view key, double value) {
  const LabParameter* parameter = find_scalar(lab.kind(), key);
  if (!parameter) throw_unknown_key("lab parameter", key, lab.kind());
  check_value(parameter->declaration, value, key);
  parameter->set(lab, value);
}

}  // namespace atomcam
