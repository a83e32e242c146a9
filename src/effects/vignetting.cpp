#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class Vignetting : public Effect {
 public:
  explicit Vignetting(const ParameterValues& values)
      : strength_(values[0]), centre_x_(values[1]), centre_y_(values[2]) {}

  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    multiply(light.response_ratio, map_.get(context, [&](int row, int column) {
      const double u = plane.u(plane.x_px(column)) - centre_x_, v = plane.v(plane.y_px(row)) - centre_y_;
      return std::max(0.0, 1 - strength_ * (u * u + v * v));
    }));
  }

 private:
  double strength_;
  double centre_x_;
  double centre_y_;
  KeptMap map_;
};

}  // namespace

EffectDeclaration vignetting() {
  return {
      .name = "vignetting",
      .plane = Plane::photons,
      .summary = "Less light reaches the corners of the sensor.",
      .reference = "Polynomial vignetting: 0-20 % at the edge",
      .parameters =
          {{.key = "strength",
            .unit = "1",
            .minimum = 0,
            .maximum = 1,
            .default_value = 0.1,
            .scale = ParameterScale::linear,
            .meaning =
                "Light lost at the sensor's left and right edge; it grows with the square of the distance."},
           {.key = "centre_x",
            .unit = "1",
            .minimum = -1,
            .maximum = 1,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning = "Position of the maximum, in half widths from the centre."},
           {.key = "centre_y",
            .unit = "1",
            .minimum = -1,
            .maximum = 1,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning = "Position of the maximum, in half widths from the centre."}},
      .observables = {"mean_map", "site_brightness"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<Vignetting>};
}

}  // namespace atomcam
