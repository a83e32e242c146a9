#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class CosmicRays : public Effect {
 public:
  explicit CosmicRays(const ParameterValues& values)
      : rate_per_cm2_s_(values[0]), electrons_per_px_(values[1]), length_px_(values[2]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const PlaneGeometry plane(context);
    const double pixel_cm = context.sensor->pixel_um() * 1e-4;
    const double area_cm2 = pixel_cm * pixel_cm * plane.region.width * plane.region.height;
    RandomStream random = context.random("hits");
    const std::int64_t hits =
        sample_poisson(random, rate_per_cm2_s_ * area_cm2 * context.settings->frame_interval_s);
    for (std::int64_t hit = 0; hit < hits; ++hit) {
      RandomStream track = context.random("track", static_cast<std::uint32_t>(hit));
      const double x = track.uniform() * plane.region.width, y = track.uniform() * plane.region.height;
      const double direction = track.uniform(), length = length_px_ * sample_exponential(track);
      const double dx = math::cos_turns(direction), dy = math::sin_turns(direction);
      for (double s = 0; s <= length; s += 1) {
        const double px = x + s * dx, py = y + s * dy;
        if (px < 0 || py < 0) continue;
        const int column = static_cast<int>(px) / plane.step_x, row = static_cast<int>(py) / plane.step_y;
        if (column >= electrons.columns() || row >= electrons.rows()) continue;
        electrons(row, column) += static_cast<std::int32_t>(sample_poisson(track, electrons_per_px_));
      }
    }
  }

 private:
  double rate_per_cm2_s_;
  double electrons_per_px_;
  double length_px_;
};

}  // namespace

EffectDeclaration cosmic_rays() {
  return {.name = "cosmic_rays",
          .plane = Plane::electrons,
          .summary = "Cosmic rays and natural radioactivity leave tracks of charge.",
          .reference = "About one muon per cm2 and minute, 80 electrons per um of silicon",
          .parameters = {{.key = "rate_per_cm2_s",
                          .unit = "1/(cm2 s)",
                          .minimum = 0,
                          .maximum = 5000,
                          .default_value = 0.02,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Hits per area and time."},
                         {.key = "electrons_per_px",
                          .unit = "e",
                          .minimum = 10,
                          .maximum = 100000,
                          .default_value = 1200,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean charge in each pixel of a track."},
                         {.key = "length_px",
                          .unit = "px",
                          .minimum = 1,
                          .maximum = 200,
                          .default_value = 4,
                          .scale = ParameterScale::logarithmic,
                          .meaning = "Mean length of a track (exponential)."}},
          .observables = {"bright_clusters"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<CosmicRays>};
}

}  // namespace atomcam
