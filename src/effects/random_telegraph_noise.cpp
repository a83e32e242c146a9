#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class RandomTelegraphNoise : public Effect {
 public:
  explicit RandomTelegraphNoise(const ParameterValues& values)
      : defects_(values[0], values[3]), amplitude_counts_(values[1]), dwell_frames_(values[2]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    // The chain starts anew in equilibrium every block of frames, so that any frame is reached in bounded
    // time: by some eight dwells. Levels lie evenly about the pixel's own mean.
    const auto block = static_cast<std::uint64_t>(std::max(8 * dwell_frames_, 16.0));
    const std::uint64_t first = context.frame / block * block;
    const auto within = static_cast<double>(context.frame - first);
    const double log_stays = math::log(1 - 1 / dwell_frames_);
    const PhiloxKey state = context.key("state");
    const auto rows = defects_.in(context);
    for (const Defects::Defect& one : rows->of(row)) {
      const double distance = amplitude_counts_ * one.size;
      RandomStream random(state, first, one.pixel);
      bool high = random.uniform() < 0.5;
      // Frames up to the next jump: a geometric law.
      for (double frame = 0;;) {
        frame += 1 + std::floor(math::log(random.uniform()) / log_stays);
        if (frame > within) break;
        high = !high;
      }
      analog_counts[static_cast<std::size_t>(one.column)] +=
          static_cast<float>(high ? distance / 2 : -distance / 2);
    }
  }

 private:
  Defects defects_;
  double amplitude_counts_;
  double dwell_frames_;
};

}  // namespace

EffectDeclaration random_telegraph_noise() {
  return {.name = "random_telegraph_noise",
          .plane = Plane::counts,
          .summary = "Some pixels jump between two levels: a single trap fills and empties.",
          .reference = "Random telegraph signal in CMOS pixels: 0.1-5 % of them",
          .parameters = {{.key = "fraction",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.5,
                          .default_value = 0.005,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Fraction of the sensor's pixels."},
                         {.key = "amplitude_counts",
                          .unit = "counts",
                          .minimum = 0.1,
                          .maximum = 1000,
                          .default_value = 15,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean distance of the levels."},
                         // A level that forgets within two frames is the converter's (dual_adc_peaks).
                         {.key = "dwell_frames",
                          .unit = "frames",
                          .minimum = 3,
                          .maximum = 1000,
                          .default_value = 5,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean time in a level."},
                         spread_of_sizes("the pixels' distances", 1)},
          .observables = {"kurtosis_map", "variance_map", "lag_correlation", "pixel_histogram"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<RandomTelegraphNoise>};
}

}  // namespace atomcam
