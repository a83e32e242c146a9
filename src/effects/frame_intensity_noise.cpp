#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class FrameIntensityNoise : public Effect {
 public:
  explicit FrameIntensityNoise(const ParameterValues& values) : sigma_(values[0]), correlation_(values[1]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    const double factor = std::max(0.0, 1 + sigma_ * autoregressive(context, "intensity", correlation_));
    for (Emitter& emitter : scene.emitters) emitter.rate_hz *= factor;
  }

 private:
  double sigma_;
  double correlation_;
};

}  // namespace

EffectDeclaration frame_intensity_noise() {
  return {
      .name = "frame_intensity_noise",
      .plane = Plane::scene,
      .summary = "The imaging light is brighter or dimmer from frame to frame.",
      .reference = "Laser intensity and frequency noise: 0.5-5 % from shot to shot",
      .parameters =
          {{.key = "sigma",
            .unit = "1",
            .minimum = 0,
            .maximum = 0.5,
            .default_value = 0.03,
            .scale = ParameterScale::linear,
            .meaning = "Relative rms of all atoms' common brightness."},
           {.key = "correlation",
            .unit = "1",
            .minimum = 0,
            .maximum = 0.9,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning =
                "Correlation of successive frames (first-order autoregressive); what is slower is a drift."}},
      .observables = {"site_correlation", "frame_means", "brightness_series"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<FrameIntensityNoise>};
}

}  // namespace atomcam
