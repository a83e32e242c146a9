#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class DualAdcPeaks : public Effect {
 public:
  explicit DualAdcPeaks(const ParameterValues& values)
      : defects_(values[0], values[2]), separation_counts_(values[1]), asymmetry_(values[3]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    const PhiloxKey path = context.key("path");
    const auto rows = defects_.in(context);
    for (const Defects::Defect& one : rows->of(row)) {
      const double separation = separation_counts_ * one.size;
      RandomStream random(path, context.frame, one.pixel);
      const double side = random.uniform() < 0.5 ? 1 : -1;
      analog_counts[static_cast<std::size_t>(one.column)] +=
          static_cast<float>((side + asymmetry_) * separation / 2);
    }
  }

 private:
  Defects defects_;
  double separation_counts_;
  double asymmetry_;
};

}  // namespace

EffectDeclaration dual_adc_peaks() {
  return {
      .name = "dual_adc_peaks",
      .plane = Plane::counts,
      .summary = "Some pixels take one of two values at random: two read paths that differ.",
      .reference = "Paper, histogram of a pixel with two peaks at all exposures",
      .parameters = {{.key = "fraction",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 1,
                      .default_value = 0.02,
                      .scale = ParameterScale::logarithmic,
                      .meaning = "Fraction of the sensor's pixels."},
                     {.key = "separation_counts",
                      .unit = "counts",
                      .minimum = 0.1,
                      .maximum = 1000,
                      .default_value = 12,
                      .scale = ParameterScale::logarithmic,
                      .meaning = "Mean distance of the two peaks."},
                     spread_of_sizes("the pixels' distances", 0.2),
                     {.key = "asymmetry",
                      .unit = "1",
                      .minimum = 0,
                      .maximum = 1,
                      .default_value = 0,
                      .scale = ParameterScale::linear,
                      .meaning =
                          "Where a pixel's offset lies: 0: midway between its peaks; 1: at the lower one."}},
      .observables = {"kurtosis_map", "variance_map", "pixel_histogram"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<DualAdcPeaks>};
}

}  // namespace atomcam
