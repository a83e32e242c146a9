#include <array>
#include <string>

#include "base/error.hpp"
#include "simulation/lab_figures.hpp"

namespace atomcam {
namespace {

std::array<const Preset*, 2> presets() {
  return {&ixon_ultra_897(), &orca_quest()};
}

const Preset& preset_of(CameraKind kind) {
  return kind == CameraKind::emccd ? ixon_ultra_897() : orca_quest();
}

void apply(Lab& lab, std::span<const Figure> figures) {
  for (const Figure& figure : figures) {
    bool known = false;
    for (const LabParameter& parameter : lab_parameters_without_defaults(lab.kind())) {
      if (parameter.declaration.key != figure.key) continue;
      parameter.set(lab, figure.value);
      known = true;
    }
    if (!known) throw Error(lab.name, "no parameter '" + std::string(figure.key) + "'");
  }
}

Lab make(const Preset& from) {
  Lab lab = from.blank();
  lab.name = from.lab_name;
  lab.serial = from.serial;
  lab.user_name = from.user_name;
  apply(lab, from.figures);
  for (const EffectFigure& figure : from.effects) {
    const EffectDeclaration* effect = find_effect(figure.name);
    if (!effect) throw Error(lab.name, "no effect '" + std::string(figure.name) + "'");
    ParameterValues values;
    for (const ParameterDeclaration& parameter : effect->parameters)
      values.push_back(parameter.default_value);
    values.at(0) = figure.strength;
    lab.effects.emplace(figure.name, std::move(values));
  }
  for (const ModeFigure& figure : from.modes) {
    std::visit([&](auto& sensor) { sensor.readout_modes.push_back(figure.mode); }, lab.sensor);
  }
  lab.settings.readout_mode = static_cast<int>(from.mode);
  lab.place_sites();
  return lab;
}

}  // namespace

Lab preset(std::string_view name) {
  // A static one: a copy is cheap, and a lab file or a settings change may ask often.
  static const std::array<Lab, 2> labs = {make(ixon_ultra_897()), make(orca_quest())};
  for (std::size_t i = 0; i < labs.size(); ++i) {
    if (presets()[i]->name == name) return labs[i];
  }
  throw_unknown("preset", "preset", name, preset_names());
}

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const Preset* one : presets()) names.emplace_back(one->name);
  return names;
}

std::string_view figure_source(CameraKind kind, std::string_view key) {
  const Preset& from = preset_of(kind);
  for (const Figure& figure : from.figures) {
    if (figure.key == key) return figure.source;
  }
  for (const EffectFigure& figure : from.effects) {
    const EffectDeclaration* effect = find_effect(figure.name);
    if (effect && key == "effects." + effect->name + "." + effect->parameters.at(0).key) return figure.source;
  }
  return {};
}

std::string_view readout_mode_source(CameraKind kind, std::size_t mode) {
  const auto modes = preset_of(kind).modes;
  return mode < modes.size() ? modes[mode].source : std::string_view{};
}

}  // namespace atomcam
