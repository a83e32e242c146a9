#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class CtiTail : public Effect {
 public:
  explicit CtiTail(const ParameterValues& values) : fraction_(values[0]), length_px_(values[1]) {}

  void apply_to_register(int, std::span<float> output_e, const Sensor::Readout&,
                         const FrameContext&) const override {
    // What is left behind is released geometrically: a share `released` of the trapped charge with every
    // pixel.
    const auto left = static_cast<float>(fraction_);
    const auto released = static_cast<float>(1 / (1 + length_px_));
    float trapped = 0;
    for (float& charge : output_e) {
      const float out = trapped * released;
      const float lost = charge * left;
      charge += out - lost;
      trapped += lost - out;
    }
  }

 private:
  double fraction_;
  double length_px_;
};

}  // namespace

EffectDeclaration cti_tail() {
  return {.name = "cti_tail",
          .plane = Plane::electron_register,
          .summary = "Charge lags behind in the register: bright pixels have a tail along the row.",
          .reference = "Charge transfer inefficiency and deferred charge: 0.1-3 % in the next pixel",
          .parameters = {{.key = "fraction",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.5,
                          .default_value = 0.01,
                          .scale = ParameterScale::linear,
                          .meaning = "Charge that is left behind."},
                         {.key = "length_px",
                          .unit = "px",
                          .minimum = 0.05,
                          .maximum = 50,
                          .default_value = 1.5,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean number of pixels after which it arrives."}},
          .observables = {"trailing_charge", "horizontal_correlation", "mean_variance_curve"},
          .emccd = true,
          .qcmos = false,
          .make = make_effect<CtiTail>};
}

}  // namespace atomcam
