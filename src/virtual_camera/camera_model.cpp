#include "virtual_camera/camera_model.hpp"

#include <string_view>

namespace atomcam {
namespace {

constexpr std::string_view zernike_prefix = "optics.zernike.";
constexpr std::string_view zernike_suffix = "_um";

FeatureDeclaration feature_of(const LabParameter& parameter, const Lab& lab) {
  const ParameterDeclaration& declaration = parameter.declaration;
  FeatureDeclaration feature;
  feature.name = parameter.feature;
  feature.category = declaration.key.starts_with("effects.") ? "SimulationEffects" : "SimulationControl";
  feature.type = parameter.boolean     ? FeatureType::boolean
                 : declaration.integer ? FeatureType::integer
                                       : FeatureType::floating;
  feature.tooltip = declaration.meaning;
  feature.unit = declaration.unit == "1" ? "" : declaration.unit;
  feature.minimum = declaration.minimum;
  feature.maximum = declaration.maximum;
  feature.logarithmic = declaration.scale == ParameterScale::logarithmic;
  feature.default_value = parameter.get(lab);
  feature.custom = true;
  return feature;
}

/// The Zernike terms as one selected feature, so that a client sees a list instead of fifteen knobs.
void add_zernike_controls(const std::vector<const LabParameter*>& terms, const Lab& lab,
                          std::vector<SourceControl>& controls) {
  FeatureDeclaration selector;
  selector.name = "SimZernikeSelector";
  selector.category = "SimulationControl";
  selector.type = FeatureType::enumeration;
  selector.tooltip = "Zernike term that SimZernikeCoefficient sets.";
  selector.custom = true;
  SourceControl coefficient{.feature = feature_of(*terms.front(), lab), .key = {}, .selected_defaults = {}};
  coefficient.feature.name = "SimZernikeCoefficient";
  coefficient.feature.tooltip = "Coefficient of the selected Zernike term: rms wavefront.";
  coefficient.feature.selector = selector.name;
  coefficient.key = std::string(zernike_prefix) + "*" + std::string(zernike_suffix);
  for (const LabParameter* term : terms) {
    std::string_view name = term->declaration.key;
    name.remove_prefix(zernike_prefix.size());
    name.remove_suffix(zernike_suffix.size());
    selector.entries.push_back(
        {std::string(name), static_cast<std::int64_t>(selector.entries.size()), term->declaration.meaning});
    coefficient.selected_defaults.push_back(term->get(lab));
  }
  controls.push_back({.feature = std::move(selector), .key = {}, .selected_defaults = {}});
  controls.push_back(std::move(coefficient));
}

}  // namespace

CameraModel camera_model(const Lab& lab, int render_threads) {
  CameraModel model;
  model.kind = lab.kind();
  model.version = ATOMCAM_VERSION;
  model.serial = lab.serial;
  model.user_name = lab.user_name;
  model.sensor = lab.sensor_shape();
  model.power_up = lab.settings;
  model.render_threads = render_threads;
  std::visit(
      [&](const auto& sensor) {
        model.model = sensor.model;
        model.pixel_um = sensor.pixel_um;
        model.readout_modes = sensor.readout_modes;
        model.adc_bits = sensor.adc_bits;
      },
      lab.sensor);
  return model;
}

std::vector<SourceControl> simulation_controls(const Lab& lab) {
  std::vector<SourceControl> controls;
  std::vector<const LabParameter*> zernike_terms_of_lab;
  for (const LabParameter& parameter : lab_parameters(lab.kind())) {
    if (!parameter.live) continue;
    if (parameter.declaration.key.starts_with(zernike_prefix))
      zernike_terms_of_lab.push_back(&parameter);
    else
      controls.push_back(
          {.feature = feature_of(parameter, lab), .key = parameter.declaration.key, .selected_defaults = {}});
  }
  if (!zernike_terms_of_lab.empty()) add_zernike_controls(zernike_terms_of_lab, lab, controls);
  return controls;
}

}  // namespace atomcam
