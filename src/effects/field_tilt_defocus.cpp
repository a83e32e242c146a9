#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class FieldTiltDefocus : public Effect {
 public:
  explicit FieldTiltDefocus(const ParameterValues& values)
      : tilt_um_(values[0]), angle_deg_(values[1]), curvature_(values[2]) {}

  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    const double cosine = math::cos_turns(angle_deg_ / 360), sine = math::sin_turns(angle_deg_ / 360);
    for (Emitter& emitter : *light.emitters) {
      const double u = plane.u(emitter.x_px), v = plane.v(emitter.y_px);
      emitter.defocus_um += tilt_um_ * (u * cosine + v * sine + curvature_ * (u * u + v * v));
    }
  }

 private:
  double tilt_um_;
  double angle_deg_;
  double curvature_;
};

}  // namespace

EffectDeclaration field_tilt_defocus() {
  return {
      .name = "field_tilt_defocus",
      .plane = Plane::photons,
      .summary =
          "The plane of the atoms is tilted or curved against the focal plane: defocus changes across the "
          "field.",
      .reference = "Paper, section Evaluation: a gradually changing defocus",
      .parameters = {{.key = "tilt_um",
                      .unit = "um",
                      .minimum = 0,
                      .maximum = 0.2,
                      .default_value = 0.05,
                      .scale = ParameterScale::linear,
                      .meaning = "Defocus (rms wavefront) at the sensor's edge, opposite at the other edge."},
                     {.key = "angle_deg",
                      .unit = "deg",
                      .minimum = 0,
                      .maximum = 360,
                      .default_value = 0,
                      .scale = ParameterScale::linear,
                      .meaning = "Direction in which the defocus grows, from +x towards +y."},
                     {.key = "curvature",
                      .unit = "1",
                      .minimum = -2,
                      .maximum = 2,
                      .default_value = 0,
                      .scale = ParameterScale::linear,
                      .meaning = "Defocus at the edge from field curvature, in parts of the tilt's."}},
      .observables = {"point_spread_field", "point_spread_width", "site_brightness", "site_histogram"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<FieldTiltDefocus>};
}

}  // namespace atomcam
