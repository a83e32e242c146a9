#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class Nonlinearity : public Effect {
 public:
  explicit Nonlinearity(const ParameterValues& values) : loss_per_count_(values[0] / 1000) {}

  void apply_to_counts(int, std::span<float> analog_counts, const FrameContext& context) const override {
    const auto bias = static_cast<float>(context.settings->bias_counts);
    const auto slope = static_cast<float>(loss_per_count_);
    // The parabola's top: beyond it the output stays there.
    const float top = 0.5f / slope;
    for (float& counts : analog_counts) {
      const float signal = std::min(counts - bias, top);
      counts = bias + signal * (1 - slope * std::max(signal, 0.0f));
    }
  }

 private:
  double loss_per_count_;
};

}  // namespace

EffectDeclaration nonlinearity() {
  return {.name = "nonlinearity",
          .plane = Plane::counts,
          .summary = "The output falls behind the light towards the full well.",
          .reference = "EMVA 1288 linearity; conversion gain that depends on the signal",
          .parameters = {{.key = "loss_per_1000_counts",
                          .unit = "1/(1000 counts)",
                          .minimum = 0,
                          .maximum = 2,
                          .default_value = 0.003,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Relative loss at 1000 counts of signal; it grows with the signal."}},
          .observables = {"mean_variance_curve"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<Nonlinearity>};
}

}  // namespace atomcam
