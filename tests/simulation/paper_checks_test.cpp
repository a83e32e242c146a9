// The paper's forward checks, through the whole simulation.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

/// The paper's camera settings: iXon Ultra 897, 2 x 2 binning, EM gain 300, 0.08 s; 3 x 3 sites in a small
/// region.
Lab paper_lab() {
  Lab lab = preset("ixon-ultra-897");
  lab.effects.clear();
  lab.optics.numerical_aperture = 0.65;
  lab.optics.wavelength_um = 0.461;
  lab.optics.magnification = 156.25;
  lab.optics.transmission = 1;
  lab.optics.zernike_um.fill(0);
  lab.scene.scattering_rate_hz = 30000;
  lab.scene.survival = 1;
  lab.scene.filling = 0.5;
  lab.scene.atom_extent_um = 0;
  lab.settings.exposure_s = 0.08;
  lab.settings.em_gain = 300;
  lab.settings.region = {192, 192, 128, 128};
  lab.settings.binning_x = lab.settings.binning_y = 2;
  std::vector<Site> sites;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      sites.push_back({212.5 + 42.3 * column, 212.5 + 41.7 * row, 1});
  lab.layout = sites;
  lab.place_sites();
  return lab;
}

/// Output pixels whose centres lie within `radius` output pixels of the site, after 2 x 2 binning.
template <class Pixels>
double region_sum(const Pixels& image, const Region& region, double x_px, double y_px, double radius) {
  const double x = (x_px + 0.5 - region.offset_x) / 2 - 0.5, y = (y_px + 0.5 - region.offset_y) / 2 - 0.5;
  double sum = 0;
  for (int row = std::max(0, static_cast<int>(y - radius - 1)); row < image.rows() && row <= y + radius + 1;
       ++row)
    for (int column = std::max(0, static_cast<int>(x - radius - 1));
         column < image.columns() && column <= x + radius + 1; ++column)
      if (std::hypot(row - y, column - x) <= radius) sum += static_cast<double>(image(row, column));
  return sum;
}

TEST(PaperChecks, PeakSeparationAtThirtyThousandPhotonsPerSecond) {
  // "one would expect a peak separation between 1.28e4 and 1.53e4": all light, or the 83.8 % within the first
  // dark ring, on quantum efficiency 0.86 and 4.85 electrons per count.
  const Lab lab = paper_lab();
  const Simulation simulation(lab);
  const double electrons_per_count =
      simulation.sensor().readout_modes()[lab.settings.readout_mode].electrons_per_count;
  const double all_light_e =
      30000 * 0.08 * collected_fraction(0.65) * simulation.sensor().quantum_efficiency();

  const int radius = 3;
  CameraSettings full = lab.settings;
  full.overrides = {{"atoms.filling", 1.0}, {"light.stray_light_photons_per_s", 0.0}};
  const PhotonImage expected = simulation.expected_electrons(0, full);
  double fraction = 0;
  for (const Site& site : lab.scene.sites)
    fraction += region_sum(expected, lab.settings.region, site.x_px, site.y_px, radius) / all_light_e / 9;

  double sum[2] = {}, sum2[2] = {};
  int count[2] = {};
  for (int n = 0; n < 2000; ++n) {
    const Frame frame = simulation.render(n);
    for (std::size_t i = 0; i < frame.truth.atoms.size(); ++i) {
      const Site& site = lab.scene.sites[i];
      const int occupied = frame.truth.atoms[i].present_at_start ? 1 : 0;
      const double counts = region_sum(frame.counts, lab.settings.region, site.x_px, site.y_px, radius);
      sum[occupied] += counts;
      sum2[occupied] += counts * counts;
      ++count[occupied];
    }
  }
  double mean[2], error2[2];
  for (const int k : {0, 1}) {
    mean[k] = sum[k] / count[k];
    error2[k] = (sum2[k] / count[k] - mean[k] * mean[k]) / count[k];
  }
  const double separation = mean[1] - mean[0], error = std::sqrt(error2[0] + error2[1]);
  const double predicted = all_light_e * fraction * lab.settings.em_gain / electrons_per_count;
  EXPECT_NEAR(separation, predicted, 5 * error);
  // In the paper's electrons per count the same photons must lie within its bounds.
  const double in_paper_counts =
      separation * electrons_per_count / 4.85 * 0.86 / simulation.sensor().quantum_efficiency();
  EXPECT_GT(in_paper_counts, 1.28e4);
  EXPECT_LT(in_paper_counts, 1.53e4);
  RecordProperty("separation_counts", std::to_string(in_paper_counts));
  RecordProperty("fraction_in_region", std::to_string(fraction));
  std::printf("peak separation %.4g counts (4.85 e-/count), %.1f %% of the light within %d binned pixels\n",
              in_paper_counts, 100 * fraction, radius);
}

TEST(PaperChecks, TheAberratedImageIsTheOneOfThePupil) {
  // The electrons of the paper's Zernike set, coma and trefoil exaggerated, against the expected image:
  // chi-square over pixels with enough light. A renderer that drops the phase of the transfer function fails
  // this by far.
  Lab lab = paper_lab();
  const auto aberrate = [](Lab& target, double coma, double trefoil, double tilt) {
    set_parameter(target, "optics.zernike.coma_horizontal_um", coma);
    set_parameter(target, "optics.zernike.trefoil_vertical_um", trefoil);
    set_parameter(target, "optics.zernike.tilt_horizontal_um", tilt);
  };
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.em_gain = 1;
  lab.scene.filling = 1;
  lab.scene.scattering_rate_hz = 3e6;
  lab.stray_light_photons_per_s = 0;
  auto& emccd = std::get<EmccdDescription>(lab.sensor);
  emccd.clock_induced_charge_e = 0;
  emccd.dark_rate_e_per_s = 0;
  for (ReadoutMode& mode : emccd.readout_modes) mode.read_noise_e = 0, mode.electrons_per_count = 1;
  Lab plain = lab;
  aberrate(lab, 0.05, 0.03, 0.02);
  const Simulation simulation(lab);
  const int frames = 40;
  Image<double, unit::counts> sum(Shape{lab.settings.output_height(), lab.settings.output_width()});
  for (int n = 0; n < frames; ++n) {
    const Frame frame = simulation.render(n);
    for (std::size_t i = 0; i < frame.counts.pixels().size(); ++i)
      sum.pixels()[i] += frame.counts.pixels()[i] - lab.settings.bias_counts;
  }
  const auto chi_square = [&](const PhotonImage& expected) {
    double value = 0;
    int pixels = 0;
    for (std::size_t i = 0; i < sum.pixels().size(); ++i) {
      const double mean = frames * static_cast<double>(expected.pixels()[i]);
      if (mean < 25) continue;
      value += (sum.pixels()[i] - mean) * (sum.pixels()[i] - mean) / mean;
      ++pixels;
    }
    return std::pair(value, pixels);
  };
  const auto [value, pixels] = chi_square(simulation.expected_electrons(0, lab.settings));
  ASSERT_GT(pixels, 1000);
  EXPECT_LT(value, pixels + 5 * std::sqrt(2.0 * pixels));
  EXPECT_GT(value, pixels - 5 * std::sqrt(2.0 * pixels));
  const auto [wrong, wrong_pixels] = chi_square(Simulation(plain).expected_electrons(0, lab.settings));
  EXPECT_GT(wrong, wrong_pixels + 100 * std::sqrt(2.0 * wrong_pixels));  // the rig sees a wrong image
}

TEST(PaperChecks, TheClosedShutterPatternOfAQcmosPersists) {
  Lab lab = preset("orca-quest");
  lab.effects.clear();
  lab.settings.region = {1024, 512, 96, 64};
  lab.settings.shutter_open = false;
  std::get<QcmosDescription>(lab.sensor).shape = {640, 1280};
  lab.settings.exposure_s = 0.01;
  const int half = 600;
  const auto mean_map = [&](const Simulation& simulation, int first) {
    std::vector<double> map(96 * 64);
    for (int n = first; n < first + half; ++n) {
      const Frame frame = simulation.render(n);
      for (std::size_t i = 0; i < map.size(); ++i) map[i] += frame.counts.pixels()[i];
    }
    return map;
  };
  const auto correlation = [](const std::vector<double>& a, const std::vector<double>& b) {
    const double n = static_cast<double>(a.size());
    const double mean_a = std::accumulate(a.begin(), a.end(), 0.0) / n,
                 mean_b = std::accumulate(b.begin(), b.end(), 0.0) / n;
    double ab = 0, aa = 0, bb = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      ab += (a[i] - mean_a) * (b[i] - mean_b);
      aa += (a[i] - mean_a) * (a[i] - mean_a);
      bb += (b[i] - mean_b) * (b[i] - mean_b);
    }
    return ab / std::sqrt(aa * bb);
  };
  const Simulation simulation(lab);
  const auto first = mean_map(simulation, 0);
  EXPECT_GT(correlation(first, mean_map(simulation, half)), 0.9);
  Lab other = lab;
  other.serial += "-other";
  EXPECT_LT(std::fabs(correlation(first, mean_map(Simulation(other), 2 * half))), 0.1);
}

}  // namespace
}  // namespace atomcam
