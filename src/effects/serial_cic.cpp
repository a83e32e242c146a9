#include "effects/effect.hpp"
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
  return {
      .name = "serial_cic",
      .plane = Plane::electron_register,
      .summary = "s",
      .reference = "r",
      .parameters =
          {{.key = "events", .unit = "1", .minimum = 0, .maximum = 1, .default_value = 0.01, .meaning = "m"}},
      .observables = {"pixel_histogram"},
      .emccd = true,
      .qcmos = false,
      .make = [](const ParameterValues& v) -> std::unique_ptr<Effect> {
        return std::make_unique<SerialCic>(v);
      }};
}
}  // namespace atomcam
