#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "simulation/lab.hpp"
#include "simulation/lab_choice.hpp"
#include "simulation/lab_figures.hpp"
#include "simulation/lab_set.hpp"
#include "simulation/lab_text_form.hpp"
#include "simulation/lab_tree.hpp"

namespace atomcam {
namespace {

void put(Tree& root, std::string_view key, Tree value) {
  const auto dot = key.rfind('.');
  Tree& table = dot == std::string_view::npos ? root : root.table(key.substr(0, dot));
  table.add(std::string(dot == std::string_view::npos ? key : key.substr(dot + 1)), std::move(value));
}

std::string comment_of(CameraKind kind, const LabParameter& parameter, double value) {
  const ParameterDeclaration& declaration = parameter.declaration;
  std::string comment = fmt::format("{} | {}", declaration.meaning,
                                    parameter.boolean ? "true or false" : allowed_text(declaration));
  const std::string_view source = figure_source(kind, declaration.key);
  if (!source.empty() && value == declaration.default_value) comment += fmt::format(" | {}", source);
  return comment;
}

void add_texts(Tree& root, const Lab& lab, std::string_view section) {
  for (const LabText& text : lab_texts(lab.kind())) {
    if (!text.key.starts_with(section) || (section.empty() && text.key.find('.') != std::string::npos))
      continue;
    std::string comment = text.meaning;
    if (text.allowed) comment += fmt::format(" | {}", fmt::join(text.allowed(lab), ", "));
    const std::string value = text.get(lab);
    // A choice among numbers: its text is the number.
    put(root, text.key,
        text.number ? Tree::of_number(parse_number(value).value_or(0), comment)
                    : Tree::of_text(value, comment));
  }
}

void add_scalars(Tree& root, const Lab& lab, std::string_view section) {
  for (const LabParameter& parameter : lab_parameters(lab.kind())) {
    const std::string& key = parameter.declaration.key;
    if (!key.starts_with(section) || (section.empty() && key.find('.') != std::string::npos)) continue;
    if (parameter.written && !parameter.written(lab)) continue;
    const double value = parameter.get(lab);
    const std::string comment = comment_of(lab.kind(), parameter, value);
    put(root, key,
        parameter.boolean ? Tree::of_boolean(value != 0, comment) : Tree::of_number(value, comment));
  }
}

void add_sites(Tree& root, const Lab& lab) {
  if (const auto* sites = std::get_if<std::vector<Site>>(&lab.layout)) {
    Tree list = Tree::array();
    for (const Site& site : *sites) {
      Tree item;
      item.add("x_px", Tree::of_number(site.x_px));
      item.add("y_px", Tree::of_number(site.y_px));
      item.add("brightness", Tree::of_number(site.brightness));
      list.items.push_back(std::move(item));
    }
    put(root, "atoms.site", std::move(list));
  }
  if (lab.given_occupancies.empty()) return;
  Tree list = Tree::array();
  list.comment = "one text a shot, used in turn; one digit a site";
  for (const Occupancy& occupancy : lab.given_occupancies) {
    std::string digits;
    for (const auto filled : occupancy) digits += filled ? '1' : '0';
    list.items.push_back(Tree::of_text(digits));
  }
  put(root, "atoms.occupancy", std::move(list));
}

void add_readout_modes(Tree& root, const Lab& lab) {
  const auto& modes = std::visit(
      [](const auto& sensor) -> const std::vector<ReadoutMode>& { return sensor.readout_modes; }, lab.sensor);
  const Preset& from = lab.kind() == CameraKind::emccd ? ixon_ultra_897() : orca_quest();
  Tree list = Tree::array();
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const ReadoutMode& mode = modes[i];
    Tree item;
    if (i < from.modes.size() && mode == from.modes[i].mode) item.comment = from.modes[i].source;
    if (lab.kind() == CameraKind::emccd) {
      item.add(
          "amplifier",
          Tree::of_text(mode.amplifier == Amplifier::conventional ? "conventional" : "electron_multiplying"));
      item.add("readout_rate_hz", Tree::of_number(mode.pixel_rate_hz));
      item.add("preamp", Tree::of_text(mode.preamp));
    } else {
      item.add("scan", Tree::of_text(mode.scan == ScanMode::standard ? "standard" : "ultra_quiet"));
    }
    item.add("electrons_per_count", Tree::of_number(mode.electrons_per_count));
    item.add("read_noise_e", Tree::of_number(mode.read_noise_e));
    list.items.push_back(std::move(item));
  }
  put(root, "sensor.readout_mode", std::move(list));
}

void add_effects(Tree& root, const Lab& lab) {
  add_scalars(root, lab, "effects.");
  for (const auto& [name, values] : lab.effects) {
    if (const EffectDeclaration* effect = find_effect(name)) {
      root.table("effects." + name).comment =
          fmt::format("{} ({}; {})", effect->summary, effect->stage(), effect->reference);
    }
  }
  // What the preset switches on and this lab does not have is switched off by its strength.
  const Lab base = preset((lab.kind() == CameraKind::emccd ? ixon_ultra_897() : orca_quest()).name);
  for (const auto& [name, values] : base.effects) {
    if (lab.effects.contains(name)) continue;
    put(root, "effects." + name + "." + find_effect(name)->parameters.at(0).key,
        Tree::of_number(0, "switched off"));
  }
}

Tree tree_of(const Lab& lab) {
  Tree root;
  root.comment =
      "A laboratory for atomcam. A key that is left out has its preset's value.\n"
      "# Behind each value: meaning | allowed | where the preset's value comes from.";
  add_texts(root, lab, "");
  add_scalars(root, lab, "");
  root.table("camera").comment = "set-points at power-up";
  put(root, "camera.preset",
      Tree::of_text(
          (lab.kind() == CameraKind::emccd ? ixon_ultra_897() : orca_quest()).name,
          fmt::format("where what is not given here comes from | {}", fmt::join(preset_names(), ", "))));
  add_texts(root, lab, "camera.");
  add_scalars(root, lab, "camera.");
  root.table("atoms").comment = "sites and what the atoms do";
  add_scalars(root, lab, "atoms.");
  add_sites(root, lab);
  root.table("optics").comment = "from the atom plane to the sensor";
  add_scalars(root, lab, "optics.");
  root.table("light");
  add_scalars(root, lab, "light.");
  root.table("sensor").comment = "the camera's figures";
  add_texts(root, lab, "sensor.");
  add_scalars(root, lab, "sensor.");
  add_readout_modes(root, lab);
  add_effects(root, lab);
  return root;
}

}  // namespace

std::string write_lab(const Lab& lab, bool commented) {
  return to_toml(tree_of(lab), commented);
}

std::string write_lab_json(const Lab& lab) {
  return to_json(tree_of(lab));
}

}  // namespace atomcam
