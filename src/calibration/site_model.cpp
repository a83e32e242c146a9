#include "calibration/site_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace atomcam {
namespace {

constexpr int stamp_radius_limit = 12;

int grid_columns(const Lab& lab) {
  const auto* grid = std::get_if<SiteGrid>(&lab.layout);
  return grid ? grid->columns : 0;
}

}  // namespace

StackModel stack_model(const Lab& lab) {
  const CameraSettings& camera = lab.settings;
  StackModel model;
  model.shape = {camera.output_height(), camera.output_width()};
  model.bias_counts = camera.bias_counts;
  double quantum_efficiency = 1, area = camera.binning_x * camera.binning_y;
  if (const auto* emccd = std::get_if<EmccdDescription>(&lab.sensor)) {
    const ReadoutMode& mode = emccd->readout_modes.at(static_cast<std::size_t>(camera.readout_mode));
    const bool multiplied = mode.amplifier == Amplifier::electron_multiplying && camera.em_gain > 1;
    const double gain = multiplied ? camera.em_gain : 1;
    model.counts_per_electron = gain / mode.electrons_per_count;
    model.read_noise_counts = mode.read_noise_e / mode.electrons_per_count;
    model.excess_noise = 2 - 1 / gain;
    model.dark_e = (emccd->dark_rate_e_per_s * camera.exposure_s + emccd->clock_induced_charge_e) * area;
    quantum_efficiency = emccd->quantum_efficiency;
  } else {
    const auto& qcmos = std::get<QcmosDescription>(lab.sensor);
    const ReadoutMode& mode = qcmos.readout_modes.at(static_cast<std::size_t>(camera.readout_mode));
    model.counts_per_electron = 1 / mode.electrons_per_count;
    model.read_noise_counts = mode.read_noise_e / mode.electrons_per_count;
    model.dark_e = qcmos.dark_rate_e_per_s * camera.exposure_s * area;
    quantum_efficiency = qcmos.quantum_efficiency;
  }
  model.background_e = lab.stray_light_photons_per_s * camera.exposure_s * quantum_efficiency * area;
  model.atom_e = lab.scene.scattering_rate_hz * camera.exposure_s *
                 collected_fraction(lab.optics.numerical_aperture) * lab.optics.transmission *
                 quantum_efficiency;
  model.filling = lab.scene.filling;
  model.site_light = PhotonImage(model.shape);

  const std::vector<Site>& sites = lab.scene.sites;
  if (sites.empty()) return model;
  const PointSpreadFunction point_spread(lab.optics, 0, lab.scene.atom_extent_um);
  double nearest = 1e9;
  for (std::size_t a = 0; a < sites.size(); ++a)
    for (std::size_t b = a + 1; b < sites.size(); ++b)
      nearest = std::min(nearest, std::hypot(sites[a].x_px - sites[b].x_px, sites[a].y_px - sites[b].y_px));
  const double bin = std::max(camera.binning_x, camera.binning_y);
  const int radius = std::clamp(static_cast<int>(std::lround(nearest / bin)), 4, stamp_radius_limit);
  const int columns = grid_columns(lab);
  for (std::size_t s = 0; s < sites.size(); ++s) {
    SiteImage site;
    // Centres of binned pixels: pixel 0 of the frame covers sensor pixels offset ... offset + binning - 1.
    site.x_px = (sites[s].x_px - camera.region.offset_x - (camera.binning_x - 1) / 2.0) / camera.binning_x;
    site.y_px = (sites[s].y_px - camera.region.offset_y - (camera.binning_y - 1) / 2.0) / camera.binning_y;
    site.grid_column = columns > 0 ? static_cast<int>(s) % columns : static_cast<int>(s);
    site.grid_row = columns > 0 ? static_cast<int>(s) / columns : 0;
    const int x = static_cast<int>(std::lround(site.x_px)), y = static_cast<int>(std::lround(site.y_px));
    site.left = std::clamp(x - radius, 0, model.shape.columns);
    site.top = std::clamp(y - radius, 0, model.shape.rows);
    const int width = std::clamp(x + radius + 1, site.left, model.shape.columns) - site.left;
    const int height = std::clamp(y + radius + 1, site.top, model.shape.rows) - site.top;
    if (width <= 0 || height <= 0) continue;  // a site outside the frame
    PhotonImage stamp({height, width});
    point_spread.add_expected(
        stamp, 1, sites[s].x_px, sites[s].y_px, camera.region.offset_x + site.left * camera.binning_x,
        camera.region.offset_y + site.top * camera.binning_y, camera.binning_x, camera.binning_y);
    site.share = RatioMap({height, width});
    std::copy(stamp.pixels().begin(), stamp.pixels().end(), site.share.pixels().begin());
    point_spread.add_expected(model.site_light, 1, sites[s].x_px, sites[s].y_px, camera.region.offset_x,
                              camera.region.offset_y, camera.binning_x, camera.binning_y);
    model.sites.push_back(std::move(site));
  }

  // Least squares over the stamp's pixels for the site and all others whose light reaches it; the others'
  // light is known to be an atom's or nothing, which keeps those far away from costing noise.
  const double read_e = model.read_noise_counts / model.counts_per_electron;
  const double prior = 0.25 * model.atom_e * model.atom_e;
  for (SiteImage& site : model.sites) {
    const int rows = site.share.rows(), columns_here = site.share.columns();
    std::vector<const SiteImage*> others;
    for (const SiteImage& other : model.sites)
      if (&other != &site && std::hypot(other.x_px - site.x_px, other.y_px - site.y_px) < 2.6 * radius)
        others.push_back(&other);
    const auto unknowns = static_cast<Eigen::Index>(others.size()) + 1;
    Eigen::MatrixXd design(static_cast<Eigen::Index>(rows) * columns_here, unknowns);
    for (Eigen::Index n = 0; n < design.rows(); ++n)
      design(n, 0) = site.share.pixels()[static_cast<std::size_t>(n)];
    for (Eigen::Index k = 1; k < unknowns; ++k) {
      const SiteImage& other = *others[static_cast<std::size_t>(k) - 1];
      PhotonImage stamp({rows, columns_here});
      point_spread.add_expected(
          stamp, 1, other.x_px * camera.binning_x + camera.region.offset_x + (camera.binning_x - 1) / 2.0,
          other.y_px * camera.binning_y + camera.region.offset_y + (camera.binning_y - 1) / 2.0,
          camera.region.offset_x + site.left * camera.binning_x,
          camera.region.offset_y + site.top * camera.binning_y, camera.binning_x, camera.binning_y);
      for (Eigen::Index n = 0; n < design.rows(); ++n)
        design(n, k) = stamp.pixels()[static_cast<std::size_t>(n)];
    }
    const double noise =
        std::max(1e-6, read_e * read_e + model.excess_noise * (model.background_e + model.dark_e) +
                           0.1 * model.excess_noise * model.atom_e * design.col(0).squaredNorm());
    Eigen::MatrixXd products = design.transpose() * design;
    for (Eigen::Index k = 1; k < unknowns; ++k) products(k, k) += noise / std::max(prior, 1e-9);
    const Eigen::VectorXd unit = Eigen::VectorXd::Unit(unknowns, 0);
    const Eigen::VectorXd weight = design * products.ldlt().solve(unit);
    site.weight = RatioMap(site.share.shape());
    for (Eigen::Index n = 0; n < weight.size(); ++n)
      site.weight.pixels()[static_cast<std::size_t>(n)] =
          static_cast<float>(weight(n) / weight.dot(design.col(0)));
  }
  return model;
}

SiteNoise site_noise(const StackModel& model) {
  SiteNoise noise;
  if (model.sites.empty()) return noise;
  // Cumulants of one electron's output in electrons: 1, F^2, and 6 for an exponential (1 without a register).
  const double second = model.excess_noise, third = model.excess_noise > 1.5 ? 6 : 1;
  const double read_e = model.read_noise_counts / model.counts_per_electron;
  for (const SiteImage& site : model.sites)
    for (std::size_t n = 0; n < site.share.pixels().size(); ++n) {
      const double w = site.weight.pixels()[n], share = site.share.pixels()[n];
      const int row = site.top + static_cast<int>(n) / site.share.columns(),
                column = site.left + static_cast<int>(n) % site.share.columns();
      const double neighbours = model.filling * model.atom_e *
                                std::max(0.0, static_cast<double>(model.site_light(row, column)) - share);
      const double even = model.background_e + model.dark_e + neighbours;
      noise.empty_variance += w * w * (read_e * read_e + second * even);
      noise.empty_third += w * w * w * third * even;
      noise.variance_per_e += w * w * second * share;
      noise.third_per_e += w * w * w * third * share;
    }
  const double sites = static_cast<double>(model.sites.size());
  noise.empty_variance /= sites;
  noise.empty_third /= sites;
  noise.variance_per_e /= sites;
  noise.third_per_e /= sites;
  return noise;
}

}  // namespace atomcam
