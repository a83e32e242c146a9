#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class RowNoise : public Effect {
 public:
  explicit RowNoise(const ParameterValues& values) : sigma_counts_(values[0]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    RandomStream random = context.random("row", static_cast<std::uint32_t>(row));
    const auto offset = static_cast<float>(sigma_counts_ * sample_normal(random));
    for (float& counts : analog_counts) counts += offset;
  }

 private:
  double sigma_counts_;
};

}  // namespace

EffectDeclaration row_noise() {
  return {.name = "row_noise",
          .plane = Plane::counts,
          .summary = "Every row of every frame has its own offset.",
          .reference = "Rolling readout: 0.02-0.1 e-; Gow et al. (2007)",
          .parameters = {{.key = "sigma_counts",
                          .unit = "counts",
                          .minimum = 0,
                          .maximum = 50,
                          .default_value = 0.5,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms of a row's offset (normal)."}},
          .observables = {"row_means", "horizontal_correlation"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<RowNoise>};
}

}  // namespace atomcam
