#include "simulation/workbench.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "base/error.hpp"
#include "simulation/lab_set.hpp"
#include "simulation/lab_text_form.hpp"

namespace atomcam {
namespace {

constexpr std::string_view place = "lab";

bool behind_the_light(const EffectDeclaration& effect) {
  return effect.plane != Plane::scene && effect.plane != Plane::photons;
}

KeyInfo info_of(const Lab& lab, const LabText& text) {
  return {.key = text.key,
          .unit = {},
          .meaning = text.meaning,
          .allowed = text.allowed ? fmt::format("{}", fmt::join(text.allowed(lab), ", ")) : "text",
          .source = {},
          .text = !text.number};
}

KeyInfo info_of(const Lab& lab, const LabParameter& parameter) {
  KeyInfo info = describe(parameter.declaration);
  info.source = figure_source(lab.kind(), info.key);
  info.live = parameter.live;
  info.boolean = parameter.boolean;
  if (info.boolean) {
    info.allowed = "true, false";
    info.integer = false;
  }
  return info;
}

struct ToText {
  std::string operator()(bool value) const { return value ? "true" : "false"; }
  std::string operator()(std::int64_t value) const { return std::to_string(value); }
  std::string operator()(double value) const { return number_text(value); }
  std::string operator()(const std::string& value) const { return value; }
};

}  // namespace

Lab load_lab(const std::string& file_or_preset, std::string_view where) {
  const std::vector<std::string> presets = preset_names();
  if (std::ranges::find(presets, file_or_preset) != presets.end()) return preset(file_or_preset);
  if (file_or_preset.find_first_of("./") == std::string::npos && !std::filesystem::exists(file_or_preset))
    throw_unknown(where, "preset (and no such file)", file_or_preset, presets);
  return read_lab(file_or_preset);
}

void save_lab(const Lab& lab, const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  if (extension != ".toml" && extension != ".json")
    throw Error(file.string(), fmt::format("extension {}; allowed .toml, .json", in_quotes(extension)));
  std::ofstream stream(file, std::ios::binary);
  stream << (extension == ".json" ? write_lab_json(lab) : write_lab(lab, true));
  stream.close();
  if (!stream) throw Error(file.string(), "cannot be written");
}

std::vector<KeyInfo> list_keys(const Lab& lab) {
  std::vector<KeyInfo> keys;
  for (const LabText& text : lab_texts(lab.kind())) keys.push_back(info_of(lab, text));
  for (const LabParameter& parameter : lab_parameters(lab.kind())) {
    const bool effect = parameter.declaration.key.starts_with("effects.");
    if (effect || !parameter.written || parameter.written(lab)) keys.push_back(info_of(lab, parameter));
  }
  return keys;
}

KeyInfo describe(const ParameterDeclaration& declaration) {
  return {.key = declaration.key,
          .unit = declaration.unit,
          .meaning = declaration.meaning,
          .allowed = allowed_text(declaration),
          .source = {},
          .minimum = declaration.minimum,
          .maximum = declaration.maximum,
          .default_value = declaration.default_value,
          .integer = declaration.integer,
          .logarithmic = declaration.scale == ParameterScale::logarithmic};
}

std::string text_of(const KeyValue& value) {
  return std::visit(ToText{}, value);
}

void set_sites(Lab& lab, std::vector<Site> sites) {
  for (std::size_t i = 0; i < sites.size(); ++i) {
    const Site& site = sites[i];
    const std::string where = fmt::format("site {}", i);
    for (const double position : {site.x_px, site.y_px}) {
      if (!(std::abs(position) <= 100000))
        throw Error(where,
                    fmt::format("position {}, {} px; allowed -100000 to 100000", site.x_px, site.y_px));
    }
    if (!(site.brightness >= 0 && site.brightness <= 1e6))
      throw Error(where, fmt::format("brightness {}; allowed 0 to 1e6", site.brightness));
  }
  lab.layout = std::move(sites);
  lab.given_occupancies.clear();
  lab.place_sites();
}

void set_occupancies(Lab& lab, std::vector<Occupancy> occupancies) {
  for (const Occupancy& shot : occupancies) {
    if (shot.size() != lab.scene.sites.size())
      throw Error("occupancies",
                  fmt::format("{} sites in a shot; the lab has {}", shot.size(), lab.scene.sites.size()));
    for (const std::uint8_t one : shot) {
      if (one > 1) throw Error("occupancies", fmt::format("value {}; allowed 0, 1", one));
    }
  }
  lab.given_occupancies = std::move(occupancies);
}

Lab with_camera_of(const Lab& lab, const Lab& other) {
  Lab joined = lab;
  joined.serial = other.serial;
  joined.user_name = other.user_name;
  joined.sensor = other.sensor;
  joined.settings = other.settings;
  for (const EffectDeclaration& effect : effect_catalogue()) {
    const auto found = other.effects.find(effect.name);
    if (behind_the_light(effect)) {
      joined.effects.erase(effect.name);
      if (found != other.effects.end()) joined.effects.insert(*found);
    } else if (joined.effects.contains(effect.name) && !find_scalar(other.kind(), "effects." + effect.name)) {
      throw_unknown_key(place, "effects." + effect.name, other.kind());
    }
  }
  joined.place_sites();
  return joined;
}

Lab Workbench::lab() const {
  const std::lock_guard lock(mutex_);
  return lab_;
}

KeyValue Workbench::get(std::string_view key) const {
  const std::lock_guard lock(mutex_);
  for (const LabText& text : lab_texts(lab_.kind())) {
    if (text.key != key) continue;
    if (text.number) return parse_number(text.get(lab_)).value_or(0);
    return text.get(lab_);
  }
  const LabParameter* parameter = find_scalar(lab_.kind(), key);
  if (!parameter) throw_unknown_key(place, key, lab_.kind());
  const double value = parameter->get(lab_);
  if (parameter->boolean) return value != 0;
  if (parameter->declaration.integer) return static_cast<std::int64_t>(std::llround(value));
  return value;
}

void Workbench::set(std::string_view key, const KeyValue& value) {
  set_text(key, text_of(value));
}

void Workbench::set_text(std::string_view key, std::string_view value) {
  change([&](Lab& lab) { set_parameter(lab, key, value, place); });
}

void Workbench::change(const std::function<void(Lab&)>& change) {
  const std::lock_guard lock(mutex_);
  Lab lab = lab_;
  change(lab);
  lab.place_sites();
  lab_ = std::move(lab);
  changed_ = true;
}

std::shared_ptr<const Simulation> Workbench::simulation() const {
  const std::lock_guard lock(mutex_);
  if (changed_ || !simulation_) {
    check_lab(lab_, place);
    simulation_ = simulation_ ? std::make_shared<const Simulation>(lab_, *simulation_)
                              : std::make_shared<const Simulation>(lab_);
    changed_ = false;
  }
  return simulation_;
}

}  // namespace atomcam
