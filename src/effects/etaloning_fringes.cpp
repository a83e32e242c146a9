#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class EtaloningFringes : public Effect {
 public:
  explicit EtaloningFringes(const ParameterValues& values) : amplitude_(values[0]), period_px_(values[1]) {}

  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    // The thickness: a wedge and three gentle waves, those of this sensor.
    RandomStream random = context.fixed("thickness");
    const double wedge = random.uniform();
    double wave_x[3], wave_y[3], phase[3];
    for (int k = 0; k < 3; ++k) {
      const double direction = random.uniform(), length = period_px_ * (3 + 6 * random.uniform());
      wave_x[k] = math::cos_turns(direction) / length;
      wave_y[k] = math::sin_turns(direction) / length;
      phase[k] = random.uniform();
    }
    const double along_x = math::cos_turns(wedge) / period_px_, along_y = math::sin_turns(wedge) / period_px_;
    multiply(light.response_ratio, map_.get(context, [&](int row, int column) {
      const double x = plane.x_px(column), y = plane.y_px(row);
      double turns = along_x * x + along_y * y;
      for (int k = 0; k < 3; ++k) turns += 0.5 * math::sin_turns(wave_x[k] * x + wave_y[k] * y + phase[k]);
      return 1 + amplitude_ * math::cos_turns(turns);
    }));
  }

 private:
  double amplitude_;
  double period_px_;
  KeptMap map_;
};

}  // namespace

EffectDeclaration etaloning_fringes() {
  return {
      .name = "etaloning_fringes",
      .plane = Plane::photons,
      .summary =
          "Interference in a thinned sensor makes contour-like fringes of sensitivity at red wavelengths.",
      .reference = "Back-illuminated sensors above 700 nm: 5-20 %, period of nanometres in wavelength",
      .parameters = {{.key = "amplitude",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 0.9,
                      .default_value = 0.05,
                      .scale = ParameterScale::linear,
                      .meaning = "Relative amplitude of the fringes."},
                     {.key = "period_px",
                      .unit = "px",
                      .minimum = 4,
                      .maximum = 2000,
                      .default_value = 60,
                      .scale = ParameterScale::logarithmic,
                      .meaning = "Mean distance of the fringes."}},
      .observables = {"mean_map", "site_brightness"},
      .known_by = {"mean_map"},  // sites some fringes apart are as bright as chance has it
      .emccd = true,
      .qcmos = true,
      .make = make_effect<EtaloningFringes>};
}

}  // namespace atomcam
