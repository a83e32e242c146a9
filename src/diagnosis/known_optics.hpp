#pragma once
// Effects that shape the mean image as aberrations do. Calibration, which knows one image for all sites and
// frames, takes them for a defocus or an astigmatism, and a fit that follows calibration would creep there.
// So the Zernike terms are fitted to the mean image with such an effect known, and held.

#include <string_view>

#include "diagnosis/model.hpp"

namespace atomcam {

inline constexpr std::string_view field_focus_effect = "field_tilt_defocus";
inline constexpr std::string_view wandering_effect = "pointing_drift";

/// The model's defocus across the field and its Zernike terms as fitted to the calibration's mean image.
void start_at_field_focus(Model& model, const FieldFocus& field, const Calibration& calibration);

/// The model's Zernike terms as `optics` has them.
void hold_zernikes(Model& model, const std::array<double, zernike_terms>& zernike_um,
                   const Calibration& calibration);

/// The Zernike terms that the calibration's mean image asks for, its image displaced as the frames show.
std::array<double, zernike_terms> zernikes_of_moving_image(const Calibration& calibration,
                                                           const FrameSequence& frames, int threads);

}  // namespace atomcam
