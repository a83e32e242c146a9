#pragma once
// A defocus across the field is fitted to the mean image first: calibration, which knows one focus only, may
// have taken for a defocus what is astigmatism, and a fit that follows calibration would creep there.

#include <string_view>

#include "diagnosis/model.hpp"

namespace atomcam {

inline constexpr std::string_view field_focus_effect = "field_tilt_defocus";

/// The model's defocus across the field and its Zernike terms as fitted to the calibration's mean image.
void start_at_field_focus(Model& model, const FieldFocus& field, const Calibration& calibration);

}  // namespace atomcam
