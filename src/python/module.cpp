#include "python/bindings.hpp"

PYBIND11_MODULE(_core, module) {
  module.doc() = "The compiled part of atomcam; use the package `atomcam`.";
  module.attr("version") = ATOMCAM_VERSION;
  atomcam::bind_error(module);
  atomcam::bind_effects(module);
  atomcam::bind_lab(module);
  atomcam::bind_stacks(module);
  atomcam::bind_calibration(module);
  atomcam::bind_diagnosis(module);
  atomcam::bind_judging(module);
}
