#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class Blinking : public Effect {
 public:
  explicit Blinking(const ParameterValues& values) : dark_fraction_(values[0]), dark_time_s_(values[1]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    const double bright_s = dark_time_s_ * (1 - dark_fraction_) / dark_fraction_;
    std::vector<Emitter> pieces;
    for (std::size_t e = 0; e < scene.emitters.size(); ++e) {
      const Emitter& emitter = scene.emitters[e];
      RandomStream random = context.random("state", static_cast<std::uint32_t>(e));
      if (emitter.end_s - emitter.start_s > 200 * (bright_s + dark_time_s_)) {
        pieces.push_back(emitter);  // so fast that only the mean remains
        pieces.back().rate_hz *= 1 - dark_fraction_;
        continue;
      }
      bool dark = random.uniform() < dark_fraction_;
      double time_s = emitter.start_s;
      while (time_s < emitter.end_s) {
        const double until_s =
            std::min(emitter.end_s, time_s + sample_exponential(random) * (dark ? dark_time_s_ : bright_s));
        if (!dark) {
          pieces.push_back(emitter);
          pieces.back().start_s = time_s;
          pieces.back().end_s = until_s;
        }
        time_s = until_s;
        dark = !dark;
      }
    }
    scene.emitters = std::move(pieces);
  }

 private:
  double dark_fraction_;
  double dark_time_s_;
};

}  // namespace

EffectDeclaration blinking() {
  return {.name = "blinking",
          .plane = Plane::scene,
          .summary = "Atoms fall into a dark state and come back during the exposure.",
          .reference = "Imperfect repumping; dark times of microseconds to milliseconds",
          .parameters = {{.key = "dark_fraction",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.9,
                          .default_value = 0.1,
                          .scale = ParameterScale::linear,
                          .meaning = "Fraction of the time that an atom is dark."},
                         {.key = "dark_time_s",
                          .unit = "s",
                          .minimum = 1e-06,
                          .maximum = 1,
                          .default_value = 0.005,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean duration of a dark time."}},
          .observables = {"site_histogram"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<Blinking>};
}

}  // namespace atomcam
