#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PixelResponseNonuniformity : public Effect {
 public:
  explicit PixelResponseNonuniformity(const ParameterValues& values)
      : sensitivity_sigma_(values[0] * std::sqrt(1 - values[1])),
        gain_sigma_(values[0] * std::sqrt(values[1])) {}

  /// Sensitivity: more photons detected, with their shot noise.
  void apply_to_light(LightField& light, const FrameContext& context) const override {
    if (sensitivity_sigma_ > 0)
      multiply(light.response_ratio, map_of(sensitivity_, context, "sensitivity", sensitivity_sigma_));
  }

  /// Gain: counts, noise and all.
  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    if (gain_sigma_ == 0) return;
    const auto bias = static_cast<float>(context.settings->bias_counts);
    const auto map = map_of(gain_, context, "pixel", gain_sigma_);
    const auto response = map->row(row);
    for (std::size_t c = 0; c < analog_counts.size(); ++c)
      analog_counts[c] = bias + (analog_counts[c] - bias) * response[c];
  }

 private:
  static std::shared_ptr<const RatioMap> map_of(const KeptMap& kept, const FrameContext& context,
                                                std::string_view stream, double sigma) {
    const PlaneGeometry plane(context);
    const double binned_sigma = sigma / std::sqrt(static_cast<double>(plane.step_x * plane.step_y));
    return kept.get(context, [&](int r, int column) {
      const int y = plane.region.offset_y + r * plane.step_y,
                x = plane.region.offset_x + column * plane.step_x;
      RandomStream random = context.fixed(stream, static_cast<std::uint32_t>(y * plane.sensor.columns + x));
      return std::max(0.0, 1 + binned_sigma * sample_normal(random));
    });
  }

  double sensitivity_sigma_, gain_sigma_;
  KeptMap sensitivity_, gain_;
};

}  // namespace

EffectDeclaration pixel_response_nonuniformity() {
  return {
      .name = "pixel_response_nonuniformity",
      .plane = Plane::counts,
      .summary = "Pixels differ in their response to light.",
      .reference = "PRNU: below 0.1 % (qCMOS), 0.3-1 % (sCMOS, EMCCD)",
      .parameters = {{.key = "sigma",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 0.3,
                      .default_value = 0.01,
                      .scale = ParameterScale::linear,
                      .meaning =
                          "Relative spread of the physical pixels' response (normal), fixed for a sensor."},
                     {.key = "gain_share",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 1,
                      .default_value = 1,
                      .scale = ParameterScale::linear,
                      .meaning = "Share of its variance that is gain, after the shot noise; the rest is "
                                 "sensitivity to light, before it."}},
      .observables = {"mean_map", "mean_variance_curve", "variance_map"},
      .emccd = true,
      .qcmos = true,
      .acts_on_light = true,
      .make = make_effect<PixelResponseNonuniformity>};
}

}  // namespace atomcam
