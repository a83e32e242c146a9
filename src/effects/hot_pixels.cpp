#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class HotPixels : public Effect {
 public:
  explicit HotPixels(const ParameterValues& values)
      : defects_(values[0], values[2]), rate_e_per_s_(values[1]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const PhiloxKey key = context.key("electrons");
    const auto rows = defects_.in(context);
    for (int row = 0; row < electrons.rows(); ++row)
      for (const Defects::Defect& one : rows->of(row)) {
        RandomStream random(key, context.frame, one.pixel);
        const double mean = rate_e_per_s_ * one.size * context.settings->exposure_s;
        electrons(row, one.column) += static_cast<std::int32_t>(sample_poisson(random, mean));
      }
  }

 private:
  Defects defects_;
  double rate_e_per_s_;
};

}  // namespace

EffectDeclaration hot_pixels() {
  return {.name = "hot_pixels",
          .plane = Plane::electrons,
          .summary = "A few pixels have a much larger dark current.",
          .reference = "Second population of the dark current; about 1 % of an iXon 888's pixels",
          .parameters = {{.key = "fraction",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.2,
                          .default_value = 0.001,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Fraction of the sensor's pixels."},
                         {.key = "rate_e_per_s",
                          .unit = "e/s",
                          .minimum = 0.01,
                          .maximum = 100000,
                          .default_value = 20,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean dark current of such a pixel."},
                         spread_of_sizes("the pixels' dark currents", 1)},
          .observables = {"mean_map", "variance_map", "bright_clusters", "pixel_histogram"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<HotPixels>};
}

}  // namespace atomcam
