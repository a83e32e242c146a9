#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class SerialCic : public Effect {
 public:
  explicit SerialCic(const ParameterValues& values) : events_(values[0]) {}

  void apply_to_register(int row, std::span<float> output_e, const Sensor::Readout& readout,
                         const FrameContext&) const override {
    readout.add_serial_clock_induced_charge(row, events_, output_e);
  }

 private:
  double events_;
};

}  // namespace

EffectDeclaration serial_cic() {
  return {.name = "serial_cic",
          .plane = Plane::electron_register,
          .summary =
              "Clock-induced charge born at any stage of the EM register comes out with a part of the gain.",
          .reference = "Harpsoe et al., A&A 542, A23 (2012); paper, section on camera effects",
          .parameters = {{.key = "events",
                          .unit = "e",
                          .minimum = 0,
                          .maximum = 5,
                          .default_value = 0.01,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean number of such charges per output pixel."}},
          .observables = {"pixel_histogram", "kurtosis_map"},
          .own_law = true,
          .emccd = true,
          .qcmos = false,
          .make = make_effect<SerialCic>};
}

}  // namespace atomcam
