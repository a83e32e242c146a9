#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class SiteBrightnessSpread : public Effect {
 public:
  explicit SiteBrightnessSpread(const ParameterValues& values) : sigma_(values[0]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    for (Emitter& emitter : scene.emitters) {
      if (emitter.site < 0) continue;
      RandomStream random = context.random_at("site", 0, static_cast<std::uint32_t>(emitter.site));
      emitter.rate_hz *= std::max(0.0, 1 + sigma_ * sample_normal(random));
    }
  }

 private:
  double sigma_;
};

}  // namespace

EffectDeclaration site_brightness_spread() {
  return {
      .name = "site_brightness_spread",
      .plane = Plane::scene,
      .summary = "Sites differ in brightness: trap depth, light shift, position in the imaging beam.",
      .reference = "Holographic tweezer arrays: depths even to a few per cent, brightness to 5-20 %",
      .parameters = {{.key = "sigma",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 0.5,
                      .default_value = 0.1,
                      .scale = ParameterScale::linear,
                      .meaning = "Relative spread of the sites (normal, cut at zero), fixed for an array."}},
      .observables = {"site_brightness", "site_histogram"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<SiteBrightnessSpread>};
}

}  // namespace atomcam
