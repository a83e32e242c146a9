#include <tuple>

#include "effects/patterns.hpp"
#include "sensor/recent.hpp"

namespace atomcam {
namespace {

class RandomTelegraphNoise : public Effect {
 public:
  explicit RandomTelegraphNoise(const ParameterValues& values)
      : defects_(values[0], values[3]), amplitude_counts_(values[1]), dwell_frames_(values[2]) {}

  void apply_to_counts(int row, std::span<float> analog_counts, const FrameContext& context) const override {
    // The chain starts anew in equilibrium every block of frames, so that any frame is reached in bounded
    // time: by some eight dwells.
    const auto block = static_cast<std::uint64_t>(std::max(8 * dwell_frames_, 16.0));
    const std::uint64_t first = context.frame / block * block, within = context.frame - first,
                        from = within / stretch * stretch;
    const auto rows = defects_.in(context);
    const PhiloxKey state = context.key("state");
    const auto levels = recent_.get({rows.get(), state, first + from}, [&] {
      return Levels{rows, levels_of(*rows, state, first, from)};
    });
    // Levels lie evenly about the pixel's own mean.
    for (const Defects::Defect& one : rows->of(row)) {
      const std::uint64_t high = levels->high[rows->number(one)] >> (within - from) & 1;
      const double distance = amplitude_counts_ * one.size;
      analog_counts[static_cast<std::size_t>(one.column)] +=
          static_cast<float>(high ? distance / 2 : -distance / 2);
    }
  }

 private:
  static constexpr std::uint64_t stretch = 64;  // frames whose levels are drawn at once: a bit each
  struct Levels {
    std::shared_ptr<const Defects::Rows> rows;
    std::vector<std::uint64_t> high;  // of each defect
  };
  using Key = std::tuple<const Defects::Rows*, PhiloxKey, std::uint64_t>;

  /// From `from` frames behind the `first` of the block on.
  std::vector<std::uint64_t> levels_of(const Defects::Rows& rows, PhiloxKey state, std::uint64_t first,
                                       std::uint64_t from) const {
    const double log_stays = math::log(1 - 1 / dwell_frames_);
    std::vector<std::uint64_t> levels;
    for (const Defects::Defect& one : rows.all()) {
      RandomStream random(state, first, one.pixel);
      // Frames up to the next jump: a geometric law.
      const auto stays = [&] { return 1 + std::floor(math::log(random.uniform()) / log_stays); };
      std::uint64_t high = random.uniform() < 0.5, bits = 0;
      double jump = stays();
      for (std::uint64_t k = 0; k < stretch; ++k) {
        for (; jump <= static_cast<double>(from + k); jump += stays()) high ^= 1;
        bits |= high << k;
      }
      levels.push_back(bits);
    }
    return levels;
  }

  Defects defects_;
  double amplitude_counts_;
  double dwell_frames_;
  mutable Recent<Key, Levels> recent_{4};
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
