#include "calibration/single_parts.hpp"

#include <algorithm>
#include <cmath>

namespace atomcam {

void add_site_brightness(Calibration& calibration, std::span<const float> brightness_e, double atom_e) {
  const std::size_t sites = static_cast<std::size_t>(calibration.optics.lattice.sites());
  std::vector<double> mean(sites, 0), error(sites, 0);
  double all = 0, counted = 0;
  for (std::size_t s = 0; s < sites; ++s) {
    double sum = 0, squares = 0, count = 0;
    for (std::size_t at = s; at < brightness_e.size(); at += sites)
      if (const double e = brightness_e[at]; e > 0.5 * atom_e) sum += e, squares += e * e, count += 1;
    if (count < 2) continue;
    mean[s] = sum / count;
    error[s] = std::sqrt(std::max(0.0, squares / count - mean[s] * mean[s]) / (count - 1));
    all += mean[s], counted += 1;
  }
  if (counted == 0) return;
  all /= counted;
  std::vector<Site> list = calibration.lab.scene.sites;
  calibration.site_brightness_error.assign(sites, 0);
  for (std::size_t s = 0; s < sites && s < list.size(); ++s) {
    // A site that never had an atom keeps the mean.
    list[s].brightness = mean[s] > 0 ? mean[s] / all : 1;
    calibration.site_brightness[s] = list[s].brightness;
    calibration.site_brightness_error[s] = error[s] / all;
  }
  calibration.lab.layout = list;
  calibration.lab.place_sites();
}

PixelMaps pixel_maps(const StackSums& darks, std::span<const std::uint8_t> odd) {
  PixelMaps maps;
  const Shape shape = darks.sum.shape();
  for (auto* map : {&maps.offset, &maps.offset_error, &maps.noise, &maps.noise_error})
    *map = Image<double, unit::counts>(shape);
  const double n = static_cast<double>(darks.frames);
  for (std::size_t i = 0; i < shape.pixels(); ++i) {
    const double noise = std::sqrt(darks.variance(i));
    maps.offset.pixels()[i] = darks.mean(i);
    maps.offset_error.pixels()[i] = noise / std::sqrt(n);
    maps.noise.pixels()[i] = noise;
    maps.noise_error.pixels()[i] = noise / std::sqrt(2 * (n - 1));
  }
  const double middle = darks.median_mean();
  for (std::size_t i = 0; i < odd.size(); ++i)
    if (odd[i])
      maps.hot.push_back({static_cast<int>(i) / shape.columns, static_cast<int>(i) % shape.columns,
                          darks.mean(i) - middle, maps.noise.pixels()[i]});
  return maps;
}

}  // namespace atomcam
