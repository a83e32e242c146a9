#include "diagnosis/known_optics.hpp"

#include <fmt/format.h>

#include <cmath>

#include "analysis/image_motion.hpp"
#include "base/math.hpp"
#include "calibration/pupil_image.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

/// Calls take(parameter, by how much it is more than calibrated) of the Zernike terms.
template <class Open, class Take>
void for_each_zernike(Open& open, const std::array<double, zernike_terms>& zernike_um,
                      const Calibration& calibration, const Take& take) {
  for (auto& one : open)
    for (std::size_t term = first_fitted_zernike; term < zernike_terms; ++term)
      if (one.name == fmt::format("zernike_{}", zernike_catalogue()[term].key))
        take(one, zernike_um[term] - calibration.optics.zernike_um[term]);
}

}  // namespace

void start_at_field_focus(Model& model, const FieldFocus& field, const Calibration& calibration) {
  const double tilt_um = std::hypot(field.x_um, field.y_um);
  if (!(tilt_um > 0)) return;
  const double angle_deg = std::atan2(field.y_um, field.x_um) * 180 / math::pi;
  const std::string effect = fmt::format("effects.{}.", field_focus_effect);
  start_at(model, {{effect + "tilt_um", tilt_um},
                   {effect + "angle_deg", angle_deg < 0 ? angle_deg + 360 : angle_deg},
                   {effect + "curvature", field.curvature_um / tilt_um}});
  hold_zernikes(model, field.zernike_um, calibration);
}

void hold_zernikes(Model& model, const std::array<double, zernike_terms>& zernike_um,
                   const Calibration& calibration) {
  for_each_zernike(model.open, zernike_um, calibration, [](Uncertain& one, double more) {
    one.move_to(one.centre + more);  // calibration errs a little: by how much, the model knows
    one.held = true;
  });
}

bool are_others(const Model& model, const std::array<double, zernike_terms>& zernike_um,
                const Calibration& calibration) {
  constexpr double clearly = 3;  // widths
  bool any = false;
  for_each_zernike(model.open, zernike_um, calibration, [&any](const Uncertain& one, double more) {
    any = any || std::fabs(more) > clearly * one.width;
  });
  return any;
}

std::array<double, zernike_terms> zernikes_of_moving_image(const Calibration& calibration,
                                                           const FrameSequence& frames, int threads) {
  const ImageMotion motion = image_motion(calibration.model, frames).without_noise();
  return fit_optics(calibration.mean_image, calibration.lab.optics, calibration.optics.lattice, nullptr,
                    &motion, threads)
      .zernike_um;
}

}  // namespace atomcam
