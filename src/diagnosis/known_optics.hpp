#pragma once
// Effects that shape the mean image as aberrations do. Calibration, which knows one image for all sites and
// frames, takes them for a defocus or an astigmatism, and a fit that follows calibration would creep there.
// So the Zernike terms are fitted to the mean image with such an effect known, and held.

#include <string_view>

#include "diagnosis/model.hpp"

namespace atomcam {

inline constexpr std::string_view field_focus_effect = "field_tilt_defocus";
inline constexpr std::string_view wandering_effect = "pointing_drift";
/// A part of what shakes is faster than an exposure, and no frame shows it: here the terms are held only
/// while the rest is fitted from far away, and let go when it is near.
inline constexpr std::string_view shaking_effect = "vibration_jitter";

/// The model's defocus across the field and its Zernike terms as fitted to the calibration's mean image.
void start_at_field_focus(Model& model, const FieldFocus& field, const Calibration& calibration);

/// The model's Zernike terms as `optics` has them.
void hold_zernikes(Model& model, const std::array<double, zernike_terms>& zernike_um,
                   const Calibration& calibration);

/// Whether any of the model's Zernike terms is clearly not as calibrated then.
bool are_others(const Model& model, const std::array<double, zernike_terms>& zernike_um,
                const Calibration& calibration);

/// The Zernike terms that the calibration's mean image asks for, its image displaced as the frames show.
std::array<double, zernike_terms> zernikes_of_moving_image(const Calibration& calibration,
                                                           const FrameSequence& frames, int threads);

}  // namespace atomcam
