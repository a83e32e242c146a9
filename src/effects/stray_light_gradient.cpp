#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class StrayLightGradient : public Effect {
 public:
  explicit StrayLightGradient(const ParameterValues& values) : amplitude_(values[0]), angle_deg_(values[1]) {}

  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    const double cosine = math::cos_turns(angle_deg_ / 360), sine = math::sin_turns(angle_deg_ / 360);
    multiply(light.background_ratio, map_.get(context, [&](int row, int column) {
      return std::max(
          0.0, 1 + amplitude_ * (plane.u(plane.x_px(column)) * cosine + plane.v(plane.y_px(row)) * sine));
    }));
  }

 private:
  double amplitude_;
  double angle_deg_;
  KeptMap map_;
};

}  // namespace

EffectDeclaration stray_light_gradient() {
  return {.name = "stray_light_gradient",
          .plane = Plane::photons,
          .summary = "Stray light is brighter on one side of the sensor.",
          .reference = "Structured background in tweezer experiments: 5-50 % of the background",
          .parameters = {{.key = "amplitude",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 1,
                          .default_value = 0.3,
                          .scale = ParameterScale::linear,
                          .meaning = "Relative change from the sensor's centre to its edge."},
                         {.key = "angle_deg",
                          .unit = "deg",
                          .minimum = 0,
                          .maximum = 360,
                          .default_value = 0,
                          .scale = ParameterScale::linear,
                          .meaning = "Direction towards more light, from +x towards +y."}},
          .observables = {"mean_map"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<StrayLightGradient>};
}

}  // namespace atomcam
