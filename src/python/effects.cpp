#include "effects/effect.hpp"

#include <pybind11/stl.h>

#include "python/bindings.hpp"

namespace atomcam {
namespace {

py::list effects() {
  py::list all;
  for (const EffectDeclaration& effect : effect_catalogue()) {
    py::list parameters;
    for (const ParameterDeclaration& parameter : effect.parameters)
      parameters.append(dictionary_of(describe(parameter)));
    py::dict one;
    one["name"] = effect.name;
    one["stage"] = effect.stage();
    one["plane"] = plane_name(effect.plane);
    one["summary"] = effect.summary;
    one["reference"] = effect.reference;
    one["observables"] = effect.observables;
    one["emccd"] = effect.emccd;
    one["qcmos"] = effect.qcmos;
    one["parameters"] = parameters;
    all.append(one);
  }
  return all;
}

}  // namespace

py::dict dictionary_of(const KeyInfo& info) {
  py::dict one;
  one["key"] = info.key;
  one["unit"] = info.unit;
  one["meaning"] = info.meaning;
  one["allowed"] = info.allowed;
  one["source"] = info.source;
  one["minimum"] = info.minimum;
  one["maximum"] = info.maximum;
  one["default"] = info.default_value;
  one["text"] = info.text;
  one["integer"] = info.integer;
  one["boolean"] = info.boolean;
  one["logarithmic"] = info.logarithmic;
  one["live"] = info.live;
  return one;
}

void bind_effects(py::module_& module) {
  module.def("effects", &effects, "Every effect of the catalogue as a dictionary.");
  module.def("preset_names", &preset_names, "Names of the presets.");
}

}  // namespace atomcam
