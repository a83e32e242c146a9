#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PointingDrift : public Effect {
 public:
  explicit PointingDrift(const ParameterValues& values)
      : amplitude_px_(values[0]), period_frames_(values[1]) {}

  void apply_to_light(LightField& light, const FrameContext& context) const override {
    light.shift_x_px += amplitude_px_ * wandering(context, "x", period_frames_);
    light.shift_y_px += amplitude_px_ * wandering(context, "y", period_frames_);
  }

 private:
  double amplitude_px_;
  double period_frames_;
};

}  // namespace

EffectDeclaration pointing_drift() {
  return {.name = "pointing_drift",
          .plane = Plane::photons,
          .summary = "The image wanders over the sensor, slowly against the frames.",
          .reference = "Thermal drift and pointing of tweezer arrays: 0.01-0.3 px from shot to shot",
          .parameters = {{.key = "amplitude_px",
                          .unit = "px",
                          .minimum = 0,
                          .maximum = 5,
                          .default_value = 0.1,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms shift per axis of the slow motion."},
                         {.key = "period_frames",
                          .unit = "frames",
                          .minimum = 4,
                          .maximum = 1e+06,
                          .default_value = 50,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Frames over which the position becomes another."}},
          .observables = {"centroid_series", "point_spread_width"},
          .known_by = {"centroid_series"},  // a strong one has anything else among its stacks
          .emccd = true,
          .qcmos = true,
          .make = make_effect<PointingDrift>};
}

}  // namespace atomcam
