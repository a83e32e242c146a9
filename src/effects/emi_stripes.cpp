#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class EmiStripes : public Effect {
 public:
  explicit EmiStripes(const ParameterValues& values) : amplitude_counts_(values[0]), period_px_(values[1]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    RandomStream random = context.random("phase");
    // The phase of a frame is random: readout is not locked to the disturbance.
    double turns =
        random.uniform() + static_cast<double>(row) * static_cast<double>(analog_counts.size()) / period_px_;
    // The sine goes on by rotation from pixel to pixel.
    double s = math::sin_turns(turns), c = math::cos_turns(turns);
    const double step_s = math::sin_turns(1 / period_px_), step_c = math::cos_turns(1 / period_px_);
    for (float& counts : analog_counts) {
      counts += static_cast<float>(amplitude_counts_ * s);
      const double next = s * step_c + c * step_s;
      c = c * step_c - s * step_s;
      s = next;
    }
  }

 private:
  double amplitude_counts_;
  double period_px_;
};

}  // namespace

EffectDeclaration emi_stripes() {
  return {.name = "emi_stripes",
          .plane = Plane::counts,
          .summary = "A disturbance with a fixed frequency is picked up along the readout: slanted stripes.",
          .reference = "Electromagnetic interference: 0.1-1 of the read noise",
          .parameters = {{.key = "amplitude_counts",
                          .unit = "counts",
                          .minimum = 0,
                          .maximum = 100,
                          .default_value = 1,
                          .scale = ParameterScale::linear,
                          .meaning = "Amplitude of the sine."},
                         {.key = "period_px",
                          .unit = "px",
                          .minimum = 2.1,
                          .maximum = 100000,
                          .default_value = 37.3,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Its period in pixels read out one after the other."}},
          .observables = {"row_spectrum", "horizontal_correlation", "row_means"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<EmiStripes>};
}

}  // namespace atomcam
