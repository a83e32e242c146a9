#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class Nonlinearity : public Effect {
 public:
  explicit Nonlinearity(const ParameterValues& values) : strength_(values[0]), reference_counts_(values[1]) {}

  void apply_to_counts(int, std::span<float> analog_counts, const FrameContext& context) const override {
    const auto bias = static_cast<float>(context.settings->bias_counts);
    const auto slope = static_cast<float>(strength_ / reference_counts_);
    // The parabola's top: beyond it the output stays there.
    const float top = 0.5f / slope;
    for (float& counts : analog_counts) {
      const float signal = std::min(counts - bias, top);
      counts = bias + signal * (1 - slope * std::max(signal, 0.0f));
    }
  }

 private:
  double strength_;
  double reference_counts_;
};

}  // namespace

EffectDeclaration nonlinearity() {
  return {.name = "nonlinearity",
          .plane = Plane::counts,
          .summary = "The output falls behind the light towards the full well.",
          .reference = "EMVA 1288 linearity; conversion gain that depends on the signal",
          .parameters = {{.key = "strength",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.5,
                          .default_value = 0.05,
                          .scale = ParameterScale::linear,
                          .meaning = "Relative loss of signal at the reference level."},
                         {.key = "reference_counts",
                          .unit = "counts",
                          .minimum = 100,
                          .maximum = 65535,
                          .default_value = 20000,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Level above the bias at which the loss is given; it grows linearly."}},
          .observables = {"mean_variance_curve"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<Nonlinearity>};
}

}  // namespace atomcam
