#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PupilApodisation : public Effect {
 public:
  explicit PupilApodisation(const ParameterValues& values) : edge_loss_(values[0]) {}

  void apply_to_light(LightField& light, const FrameContext&) const override {
    light.pupil_edge_loss = edge_loss_;
  }

 private:
  double edge_loss_;
};

}  // namespace

EffectDeclaration pupil_apodisation() {
  return {
      .name = "pupil_apodisation",
      .plane = Plane::photons,
      .summary = "The objective passes less at its edge: the image's core is wider, its rings are fainter.",
      .reference = "Oblique incidence on coatings, a clipped edge; Born & Wolf, section 8.6.3 (apodization)",
      .parameters = {{.key = "edge_loss",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 1,
                      .default_value = 0.2,
                      .scale = ParameterScale::linear,
                      .meaning = "Amplitude that the pupil's edge lacks beside its centre, in parts; it "
                                 "grows with the radius squared. What passes is as bright."}},
      .observables = {"point_spread_width", "point_spread_halo"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<PupilApodisation>};
}

}  // namespace atomcam
