#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class VibrationJitter : public Effect {
 public:
  explicit VibrationJitter(const ParameterValues& values)
      : amplitude_um_(values[0]), anisotropy_(values[1]), angle_deg_(values[2]) {}

  void apply_to_light(LightField& light, const FrameContext&) const override {
    for (Emitter& emitter : *light.emitters) {
      emitter.blur_major_um = amplitude_um_;
      emitter.blur_minor_um = (1 - anisotropy_) * amplitude_um_;
      emitter.blur_angle_deg = angle_deg_;
    }
  }

 private:
  double amplitude_um_;
  double anisotropy_;
  double angle_deg_;
};

}  // namespace

EffectDeclaration vibration_jitter() {
  return {.name = "vibration_jitter",
          .plane = Plane::photons,
          .summary =
              "Objective or atoms vibrate during the exposure: images are blurred, more along one direction.",
          .reference = "Objective vibration of 20-100 nm",
          .parameters = {{.key = "amplitude_um",
                          .unit = "um",
                          .minimum = 0,
                          .maximum = 1,
                          .default_value = 0.1,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms motion in the object plane along the angle."},
                         {.key = "anisotropy",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 1,
                          .default_value = 0.5,
                          .scale = ParameterScale::linear,
                          .meaning = "1: along a line; 0: the same in all directions."},
                         {.key = "angle_deg",
                          .unit = "deg",
                          .minimum = 0,
                          .maximum = 180,
                          .default_value = 0,
                          .scale = ParameterScale::linear,
                          .meaning = "Direction of the motion, from +x towards +y."}},
          .observables = {"point_spread_width"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<VibrationJitter>};
}

}  // namespace atomcam
