#include "diagnosis/field_focus.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "base/math.hpp"
#include "calibration/pupil_image.hpp"
#include "optics/zernike.hpp"

namespace atomcam {

void start_at_field_focus(Model& model, const FieldFocus& field, const Calibration& calibration) {
  const double tilt_um = std::hypot(field.x_um, field.y_um);
  if (!(tilt_um > 0)) return;
  const double angle_deg = std::atan2(field.y_um, field.x_um) * 180 / math::pi;
  const std::string effect = fmt::format("effects.{}.", field_focus_effect);
  const std::map<std::string, double> values{
      {effect + "tilt_um", tilt_um},
      {effect + "angle_deg", angle_deg < 0 ? angle_deg + 360 : angle_deg},
      {effect + "curvature", field.curvature_um / tilt_um}};
  for (Uncertain& one : model.open) {
    if (const auto found = values.find(one.name); found != values.end())
      one.centre = std::clamp(one.coordinate_of(found->second), one.lowest, one.highest);
    for (int term = first_fitted_zernike; term < zernike_terms; ++term)
      if (one.name == fmt::format("zernike_{}", zernike_catalogue()[term].key)) {
        one.move_to(one.centre + field.zernike_um[term] - calibration.optics.zernike_um[term]);
        one.held = true;
      }
  }
}

}  // namespace atomcam
