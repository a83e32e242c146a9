#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class ScatterHalo : public Effect {
 public:
  explicit ScatterHalo(const ParameterValues& values) : fraction_(values[0]), scale_px_(values[1]) {}

  void apply_to_light(LightField& light, const FrameContext&) const override {
    light.halo_fraction = fraction_;
    light.halo_scale_px = scale_px_;
  }

 private:
  double fraction_;
  double scale_px_;
};

}  // namespace

EffectDeclaration scatter_halo() {
  return {.name = "scatter_halo",
          .plane = Plane::photons,
          .summary = "A part of the light is scattered far from the image: dust, coatings, roughness.",
          .reference = "Stray light of imaging optics; exponential halo",
          .parameters =
              {{.key = "fraction",
                .unit = "1",
                .minimum = 0,
                .maximum = 0.8,
                .default_value = 0.05,
                .scale = ParameterScale::linear,
                .meaning = "Fraction of the light that is scattered."},
               {.key = "scale_px",
                .unit = "px",
                .minimum = 3,
                .maximum = 500,
                .default_value = 12,
                .scale = ParameterScale::logarithmic,
                .meaning =
                    "Mean distance at which it lands; nearer it would be the image itself that is wider."}},
          .observables = {"point_spread_halo", "site_histogram"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<ScatterHalo>};
}

}  // namespace atomcam
