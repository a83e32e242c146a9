// The list of effects, in the order in which they apply within their plane. A new effect adds its declaration
// here, twice.

#include <array>

#include "effects/effect.hpp"

namespace atomcam {

EffectDeclaration site_brightness_spread();
EffectDeclaration site_position_scatter();
EffectDeclaration fluorescence_drift();
EffectDeclaration frame_intensity_noise();
EffectDeclaration atom_hopping();
EffectDeclaration blinking();
EffectDeclaration field_tilt_defocus();
EffectDeclaration vibration_jitter();
EffectDeclaration pointing_drift();
EffectDeclaration pupil_apodisation();
EffectDeclaration scatter_halo();
EffectDeclaration stray_light_gradient();
EffectDeclaration vignetting();
EffectDeclaration etaloning_fringes();
EffectDeclaration hot_pixels();
EffectDeclaration cosmic_rays();
EffectDeclaration pixel_crosstalk();
EffectDeclaration image_lag();
EffectDeclaration frame_transfer_smear();
EffectDeclaration serial_cic();
EffectDeclaration cti_tail();
EffectDeclaration pixel_response_nonuniformity();
EffectDeclaration nonlinearity();
EffectDeclaration random_telegraph_noise();
EffectDeclaration dual_adc_peaks();
EffectDeclaration row_noise();
EffectDeclaration emi_stripes();
EffectDeclaration bias_drift();

std::span<const EffectDeclaration> effect_catalogue() {
  static const std::array catalogue = {
      site_brightness_spread(),
      site_position_scatter(),
      fluorescence_drift(),
      frame_intensity_noise(),
      atom_hopping(),
      blinking(),
      field_tilt_defocus(),
      vibration_jitter(),
      pointing_drift(),
      pupil_apodisation(),
      scatter_halo(),
      stray_light_gradient(),
      vignetting(),
      etaloning_fringes(),
      hot_pixels(),
      cosmic_rays(),
      pixel_crosstalk(),
      image_lag(),
      frame_transfer_smear(),
      serial_cic(),
      cti_tail(),
      pixel_response_nonuniformity(),
      nonlinearity(),
      random_telegraph_noise(),
      dual_adc_peaks(),
      row_noise(),
      emi_stripes(),
      bias_drift(),
  };
  return catalogue;
}

const EffectDeclaration* find_effect(std::string_view name) {
  for (const EffectDeclaration& declaration : effect_catalogue())
    if (declaration.name == name) return &declaration;
  return nullptr;
}

}  // namespace atomcam
