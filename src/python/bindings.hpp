#pragma once
// The extension module `atomcam._core`: one file for each subject, each with a function that module.cpp
// calls. The Python package (python/atomcam) gives it its form; what users see is written there.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "simulation/workbench.hpp"

namespace atomcam {

namespace py = pybind11;

void bind_error(py::module_& module);
void bind_effects(py::module_& module);
void bind_lab(py::module_& module);
/// FrameSequence as "Frames", Notes: what calibration, diagnosis and judging take.
void bind_stacks(py::module_& module);
void bind_calibration(py::module_& module);
void bind_diagnosis(py::module_& module);
void bind_judging(py::module_& module);

/// A declaration as a dictionary.
py::dict dictionary_of(const KeyInfo& info);

}  // namespace atomcam
