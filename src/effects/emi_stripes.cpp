#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class EmiStripes : public Effect {
 public:
  explicit EmiStripes(const ParameterValues& values)
      : amplitude_counts_(values[0]),
        period_px_(values[1]),
        turns_per_row_(values[2] / 360),
        drift_turns_(values[3]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    const double turns = phase_turns(context) + row * turns_per_row_;
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
  /// A random walk from frame to frame, from a new phase every block of frames.
  double phase_turns(const FrameContext& context) const {
    const std::uint64_t block = context.frame / walk_frames;
    RandomStream start = context.random_at("phase", block);
    return start.uniform() + drift_turns_ * random_walk(context, "drift");
  }

  double amplitude_counts_;
  double period_px_;
  double turns_per_row_;
  double drift_turns_;
};

}  // namespace

EffectDeclaration emi_stripes() {
  return {.name = "emi_stripes",
          .plane = Plane::counts,
          .summary = "A disturbance with a fixed frequency is picked up along the readout: slanted stripes.",
          .reference = "Electromagnetic interference: 0.1-1 of the read noise, its phase drifting",
          .parameters =
              {{.key = "amplitude_counts",
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
                .meaning = "Its period in pixels read out one after the other."},
               // Rows take the time of their pixels and of an overhead that no camera's data sheet tells.
               {.key = "row_phase_deg",
                .unit = "deg",
                .minimum = -180,
                .maximum = 180,
                .default_value = 60,
                .scale = ParameterScale::linear,
                .meaning = "By how much its phase goes on from row to row, whole turns left out."},
               {.key = "phase_drift_turns",
                .unit = "turns",
                .minimum = 0.001,
                .maximum = 0.5,
                .default_value = 0.2,
                .scale = ParameterScale::logarithmic,
                .meaning = "Random change of its phase from frame to frame (standard deviation): 0.5 "
                           "leaves frames unrelated, little makes the stripes stand."}},
          .observables = {"row_spectrum", "horizontal_correlation", "vertical_correlation", "row_means",
                          "lag_correlation"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<EmiStripes>};
}

}  // namespace atomcam
