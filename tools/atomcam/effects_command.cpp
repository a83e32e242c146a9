// atomcam effects: the catalogue, or one effect in full.

#include <algorithm>
#include <memory>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "atomcam/commands.hpp"
#include "base/error.hpp"
#include "effects/effect.hpp"
#include "simulation/lab.hpp"

namespace atomcam {
namespace {

std::string_view cameras(const EffectDeclaration& effect) {
  return effect.emccd && effect.qcmos ? "both" : effect.emccd ? "EMCCD" : effect.qcmos ? "qCMOS" : "none";
}

void print_list() {
  std::size_t widest = 0;
  for (const EffectDeclaration& effect : effect_catalogue()) widest = std::max(widest, effect.name.size());
  fmt::print("{:<{}}  {:<9}  {:<7}  {}\n", "effect", widest, "plane", "cameras", "what it does");
  for (const EffectDeclaration& effect : effect_catalogue()) {
    fmt::print("{:<{}}  {:<9}  {:<7}  {}\n", effect.name, widest, plane_name(effect.plane), cameras(effect),
               effect.summary);
  }
  fmt::print("\n`atomcam effects NAME` prints one in full.\n");
}

std::string feature_of(const EffectDeclaration& effect, const ParameterDeclaration& parameter) {
  const CameraKind kind = effect.emccd ? CameraKind::emccd : CameraKind::qcmos;
  const LabParameter* found = find_lab_parameter(kind, "effects." + effect.name + "." + parameter.key);
  return found ? found->feature : std::string{};
}

void print_one(const EffectDeclaration& effect) {
  fmt::print("{}: {}\n\n", effect.name, effect.summary);
  fmt::print("  stage        {} (plane: {})\n", effect.stage(), plane_name(effect.plane));
  fmt::print("  cameras      {}\n", cameras(effect));
  fmt::print("  reference    {}\n", effect.reference);
  fmt::print("  observables  {}\n\n", fmt::join(effect.observables, ", "));
  for (std::size_t i = 0; i < effect.parameters.size(); ++i) {
    const ParameterDeclaration& parameter = effect.parameters[i];
    fmt::print("  {}{}\n", parameter.key, i == 0 ? "  (the strength: at 0 the effect is absent)" : "");
    fmt::print("      {}\n", parameter.meaning);
    fmt::print("      {} to {}{}{}, default {}{}{}; feature {}\n", parameter.minimum, parameter.maximum,
               parameter.unit == "1" ? "" : " ", parameter.unit == "1" ? "" : parameter.unit,
               parameter.default_value, parameter.integer ? ", whole numbers" : "",
               parameter.scale == ParameterScale::logarithmic ? ", logarithmic" : "",
               feature_of(effect, parameter));
  }
  fmt::print("\nIn a lab file:\n\n[effects.{}]\n", effect.name);
  for (const ParameterDeclaration& parameter : effect.parameters) {
    fmt::print("{} = {}\n", parameter.key, parameter.default_value);
  }
}

void run(const std::string& name) {
  if (name.empty()) return print_list();
  const EffectDeclaration* effect = find_effect(name);
  if (effect) return print_one(*effect);
  std::vector<std::string> known;
  for (const EffectDeclaration& one : effect_catalogue()) known.push_back(one.name);
  throw_unknown("NAME", "effect", name.substr(0, 100), known);
}

}  // namespace

void add_effects_command(CLI::App& app) {
  auto name = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("effects", "List the physical effects, or print one in full");
  command->add_option("NAME", *name, "An effect of the list");
  command->callback([name] {
    try {
      run(*name);
    } catch (const Error& error) {
      fmt::print(stderr, "atomcam effects: {}\n", error.what());
      throw CLI::RuntimeError(2);
    }
  });
}

}  // namespace atomcam
