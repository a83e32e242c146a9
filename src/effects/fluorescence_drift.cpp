#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class FluorescenceDrift : public Effect {
 public:
  explicit FluorescenceDrift(const ParameterValues& values)
      : amplitude_(values[0]), period_frames_(values[1]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    const double factor = std::max(0.0, 1 + amplitude_ * wandering(context, "drift", period_frames_));
    for (Emitter& emitter : scene.emitters) emitter.rate_hz *= factor;
  }

 private:
  double amplitude_;
  double period_frames_;
};

}  // namespace

EffectDeclaration fluorescence_drift() {
  return {.name = "fluorescence_drift",
          .plane = Plane::scene,
          .summary = "The atoms' brightness drifts slowly along the stack.",
          .reference = "Drift of laser frequency and alignment over minutes to hours",
          .parameters = {{.key = "amplitude",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.5,
                          .default_value = 0.05,
                          .scale = ParameterScale::linear,
                          .meaning = "Relative rms of the drift."},
                         {.key = "period_frames",
                          .unit = "frames",
                          .minimum = 10,
                          .maximum = 1e+06,
                          .default_value = 300,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Frames over which the brightness becomes another."}},
          .observables = {"brightness_series", "frame_means", "site_correlation"},
          .known_by = {"brightness_series"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<FluorescenceDrift>};
}

}  // namespace atomcam
