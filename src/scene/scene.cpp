#include "scene/scene.hpp"

#include <cmath>

#include "base/error.hpp"
#include "base/math.hpp"
#include "base/samplers.hpp"

namespace atomcam {
namespace {

void require(bool holds, const char* place, double value, const char* allowed) {
  if (!holds) throw Error(place, "is " + std::to_string(value) + ", must be " + allowed);
}

void check(const SceneDescription& scene, double exposure_s, const Occupancy* given) {
  require(scene.filling >= 0 && scene.filling <= 1, "filling", scene.filling, "from 0 to 1");
  require(scene.survival >= 0 && scene.survival <= 1, "survival", scene.survival, "from 0 to 1");
  require(scene.reference_exposure_s > 0, "reference_exposure_s", scene.reference_exposure_s, "above 0");
  require(scene.scattering_rate_hz >= 0, "scattering_rate_hz", scene.scattering_rate_hz, "0 or more");
  require(scene.images_per_shot >= 1, "images_per_shot", scene.images_per_shot, "1 or more");
  require(exposure_s >= 0, "exposure_s", exposure_s, "0 or more");
  if (given && given->size() != scene.sites.size())
    throw Error("given occupancy", "has " + std::to_string(given->size()) + " sites, the scene has " +
                                       std::to_string(scene.sites.size()));
}

/// Exponential law at a constant rate, cut off at the exposure: `never` if the atom outlives it. Given a
/// loss, t is distributed as the paper's (p^t - 1) / (p - 1) in units of the exposure, p = exp(-rate *
/// exposure).
double loss_time(const PhiloxKey& key, std::uint64_t frame, std::uint32_t site, double rate_hz,
                 double exposure_s) {
  if (rate_hz <= 0) return never;
  RandomStream random(key, frame, site);
  const double time = sample_exponential(random) / rate_hz;
  return time < exposure_s ? time : never;
}

}  // namespace

std::vector<Site> grid_sites(const SiteGrid& grid, double pixels_per_um, double centre_x_px,
                             double centre_y_px) {
  require(grid.columns >= 0, "columns", grid.columns, "0 or more");
  require(grid.rows >= 0, "rows", grid.rows, "0 or more");
  const double scale = grid.object_plane ? pixels_per_um : 1;
  const double origin_x = grid.object_plane ? centre_x_px : 0;
  const double origin_y = grid.object_plane ? centre_y_px : 0;
  const double step_x_x = grid.spacing_x * math::cos_turns(grid.angle_x_deg / 360);
  const double step_x_y = grid.spacing_x * math::sin_turns(grid.angle_x_deg / 360);
  const double step_y_x = -grid.spacing_y * math::sin_turns(grid.angle_y_deg / 360);
  const double step_y_y = grid.spacing_y * math::cos_turns(grid.angle_y_deg / 360);
  std::vector<Site> sites;
  sites.reserve(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
  for (int j = 0; j < grid.rows; ++j)
    for (int i = 0; i < grid.columns; ++i)
      sites.push_back({origin_x + scale * (grid.offset_x + i * step_x_x + j * step_y_x),
                       origin_y + scale * (grid.offset_y + i * step_x_y + j * step_y_y), 1});
  return sites;
}

SceneFrame draw_scene(const SceneDescription& scene, double exposure_s, std::uint64_t seed,
                      std::uint64_t frame, const Occupancy* given) {
  check(scene, exposure_s, given);
  const auto images = static_cast<std::uint64_t>(scene.images_per_shot);
  const std::uint64_t shot = frame / images, first = shot * images;
  const PhiloxKey filling_key = stream_key(seed, stream_id("scene/filling"));
  const PhiloxKey loss_key = stream_key(seed, stream_id("scene/loss"));
  // survival 0 is an infinite rate: every atom is lost as the exposure begins.
  const double rate_hz = scene.survival > 0 ? -math::log(scene.survival) / scene.reference_exposure_s : never;

  SceneFrame result;
  result.atoms.resize(scene.sites.size());
  for (std::size_t s = 0; s < scene.sites.size(); ++s) {
    const Site& site = scene.sites[s];
    const auto block = static_cast<std::uint32_t>(s);
    bool present =
        given ? (*given)[s] != 0 : RandomStream(filling_key, shot, block).uniform53() < scene.filling;
    for (std::uint64_t image = first; present && image < frame; ++image)
      present = loss_time(loss_key, image, block, rate_hz, exposure_s) == never;

    Atom& atom = result.atoms[s];
    atom.site = static_cast<int>(s);
    if (!present) continue;
    atom.present_at_start = true;
    atom.loss_time_s = loss_time(loss_key, frame, block, rate_hz, exposure_s);
    atom.present_at_end = atom.loss_time_s == never;
    const double end_s = std::fmin(atom.loss_time_s, exposure_s);
    const double rate = scene.scattering_rate_hz * site.brightness;
    atom.photons_emitted = rate * end_s;
    if (atom.photons_emitted <= 0) continue;
    Emitter emitter;
    emitter.site = atom.site;
    emitter.x_px = site.x_px;
    emitter.y_px = site.y_px;
    emitter.end_s = end_s;
    emitter.rate_hz = rate;
    result.emitters.push_back(emitter);
  }
  return result;
}

}  // namespace atomcam
