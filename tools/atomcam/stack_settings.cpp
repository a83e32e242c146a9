#include "atomcam/stack_settings.hpp"

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace atomcam {
namespace {

/// Calls visit(key, member) for every member.
template <class Settings, class Visitor>
void for_each(Settings& settings, const Visitor& visit) {
  visit("command", settings.command);
  visit("camera", settings.camera);
  visit("serial", settings.serial);
  visit("seed", settings.seed);
  visit("first_frame", settings.first_frame);
  visit("exposure_s", settings.exposure_s);
  visit("offset_x_px", settings.offset_x);
  visit("offset_y_px", settings.offset_y);
  visit("binning_x", settings.binning_x);
  visit("binning_y", settings.binning_y);
  visit("em_gain", settings.em_gain);
  visit("electrons_per_count", settings.electrons_per_count);
  visit("bias_counts", settings.bias_counts);
  visit("pixel_format", settings.pixel_format);
}

}  // namespace

std::string StackSettings::to_json() const {
  nlohmann::ordered_json json;
  json["program"] = "atomcam " ATOMCAM_VERSION;
  for_each(*this, [&](const char* key, const auto& value) { json[key] = value; });
  return json.dump();
}

StackSettings StackSettings::parse(const std::string& text, const std::string& place) {
  StackSettings settings;
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) throw Error(place, "it holds no settings of a camera");
  try {
    for_each(settings, [&](const char* key, auto& value) { json.at(key).get_to(value); });
  } catch (const nlohmann::json::exception& error) {
    throw Error(place, std::string("its settings are not complete: ") + error.what());
  }
  return settings;
}

StackSettings StackSettings::of(const Lab& lab) {
  const CameraSettings& camera = lab.settings;
  StackSettings settings;
  settings.serial = lab.serial;
  settings.seed = lab.seed;
  settings.exposure_s = camera.exposure_s;
  settings.offset_x = camera.region.offset_x;
  settings.offset_y = camera.region.offset_y;
  settings.binning_x = camera.binning_x;
  settings.binning_y = camera.binning_y;
  settings.bias_counts = camera.bias_counts;
  std::visit(
      [&](const auto& sensor) {
        settings.camera = sensor.model;
        const ReadoutMode& mode = sensor.readout_modes.at(static_cast<std::size_t>(camera.readout_mode));
        settings.electrons_per_count = mode.electrons_per_count;
        if (lab.kind() == CameraKind::emccd && mode.amplifier == Amplifier::electron_multiplying)
          settings.em_gain = camera.em_gain;
      },
      lab.sensor);
  if (lab.kind() == CameraKind::qcmos && camera.photon_number_resolving) settings.electrons_per_count = 1;
  return settings;
}

}  // namespace atomcam
