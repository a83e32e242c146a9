#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PixelResponseNonuniformity : public Effect {
 public:
  explicit PixelResponseNonuniformity(const ParameterValues& values) : sigma_(values[0]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    const double binned_sigma = sigma_ / std::sqrt(static_cast<double>(plane.step_x * plane.step_y));
    const auto map = map_.get(context, [&](int r, int column) {
      const int y = plane.region.offset_y + r * plane.step_y,
                x = plane.region.offset_x + column * plane.step_x;
      RandomStream random = context.fixed("pixel", static_cast<std::uint32_t>(y * plane.sensor.columns + x));
      return std::max(0.0, 1 + binned_sigma * sample_normal(random));
    });
    const auto bias = static_cast<float>(context.settings->bias_counts);
    const auto response = map->row(row);
    for (std::size_t c = 0; c < analog_counts.size(); ++c)
      analog_counts[c] = bias + (analog_counts[c] - bias) * response[c];
  }

 private:
  double sigma_;
  KeptMap map_;
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
                          "Relative spread of the physical pixels' response (normal), fixed for a sensor."}},
      .observables = {"mean_map", "mean_variance_curve", "variance_map"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<PixelResponseNonuniformity>};
}

}  // namespace atomcam
