#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class BiasDrift : public Effect {
 public:
  explicit BiasDrift(const ParameterValues& values)
      : rms_counts_(values[0]), period_frames_(values[1]), frame_counts_(values[2]) {}

  void apply_to_counts(int, std::span<float> analog_counts, const FrameContext& context) const override {
    RandomStream random = context.random("frame");
    const auto offset = static_cast<float>(rms_counts_ * wandering(context, "drift", period_frames_) +
                                           frame_counts_ * sample_normal(random));
    for (float& counts : analog_counts) counts += offset;
  }

 private:
  double rms_counts_;
  double period_frames_;
  double frame_counts_;
};

}  // namespace

EffectDeclaration bias_drift() {
  return {.name = "bias_drift",
          .plane = Plane::counts,
          .summary = "The bias level of whole frames wanders.",
          .reference = "Bias clamp noise and drift: 0.1-2 counts per frame",
          .parameters = {{.key = "rms_counts",
                          .unit = "counts",
                          .minimum = 0,
                          .maximum = 100,
                          .default_value = 1,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms of the slow drift."},
                         {.key = "period_frames",
                          .unit = "frames",
                          .minimum = 1,
                          .maximum = 1e+06,
                          .default_value = 100,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Frames over which the bias becomes another."},
                         {.key = "frame_counts",
                          .unit = "counts",
                          .minimum = 0,
                          .maximum = 100,
                          .default_value = 0,
                          .scale = ParameterScale::linear,
                          .meaning = "Rms of a part that is new in every frame."}},
          .observables = {"frame_means", "pixel_histogram"},
          .known_by = {"frame_means"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<BiasDrift>};
}

}  // namespace atomcam
