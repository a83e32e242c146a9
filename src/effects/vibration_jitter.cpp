#include <cmath>

#include "base/math.hpp"
#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class VibrationJitter : public Effect {
 public:
  explicit VibrationJitter(const ParameterValues& values)
      : amplitude_um_(values[0]), anisotropy_(values[1]), angle_deg_(values[2]), slow_share_(values[3]) {}

  // What is faster than the exposure blurs; what is slower displaces the whole frame.
  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const double blur_um = amplitude_um_ * std::sqrt(1 - slow_share_);
    for (Emitter& emitter : *light.emitters) {
      emitter.blur_major_um = blur_um;
      emitter.blur_minor_um = (1 - anisotropy_) * blur_um;
      emitter.blur_angle_deg = angle_deg_;
    }
    if (slow_share_ == 0) return;
    RandomStream random = context.random("slow");
    const double pixels_per_um = context.optics->magnification / context.optics->pixel_um;
    const double shift_px = amplitude_um_ * std::sqrt(slow_share_) * pixels_per_um;
    const double along = shift_px * sample_normal(random),
                 across = (1 - anisotropy_) * shift_px * sample_normal(random);
    const double turns = angle_deg_ / 360, c = math::cos_turns(turns), s = math::sin_turns(turns);
    light.shift_x_px += along * c - across * s;
    light.shift_y_px += along * s + across * c;
  }

 private:
  double amplitude_um_;
  double anisotropy_;
  double angle_deg_;
  double slow_share_;
};

}  // namespace

EffectDeclaration vibration_jitter() {
  return {.name = "vibration_jitter",
          .plane = Plane::photons,
          .summary = "Objective or atoms vibrate: images are blurred, and displaced anew in every frame.",
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
                          .meaning = "Direction of the motion, from +x towards +y."},
                         {.key = "slow_share",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 1,
                          .default_value = 0.5,
                          .scale = ParameterScale::linear,
                          .meaning = "Share of the motion's variance that is slower than the exposure."}},
          .observables = {"point_spread_width", "centroid_series"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<VibrationJitter>};
}

}  // namespace atomcam
