#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class SitePositionScatter : public Effect {
 public:
  explicit SitePositionScatter(const ParameterValues& values) : sigma_px_(values[0]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    for (Emitter& emitter : scene.emitters) {
      if (emitter.site < 0) continue;
      RandomStream random = context.random_at("site", 0, static_cast<std::uint32_t>(emitter.site));
      emitter.x_px += sigma_px_ * sample_normal(random);
      emitter.y_px += sigma_px_ * sample_normal(random);
    }
  }

 private:
  double sigma_px_;
};

}  // namespace

EffectDeclaration site_position_scatter() {
  return {.name = "site_position_scatter",
          .plane = Plane::scene,
          .summary = "Traps are not exactly on the lattice: aberrations and speckle of the trapping light.",
          .reference = "Holographic tweezer arrays before correction: some hundredths of the spacing",
          .parameters = {{.key = "sigma_px",
                          .unit = "px",
                          .minimum = 0,
                          .maximum = 2,
                          .default_value = 0.05,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms offset of a site per axis (normal), fixed for an array."}},
          .observables = {"point_spread_field", "point_spread_width", "centroid_series"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<SitePositionScatter>};
}

}  // namespace atomcam
