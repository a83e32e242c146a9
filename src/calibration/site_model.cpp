#include "calibration/site_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

#include "calibration/count_law.hpp"

namespace atomcam {
namespace {

constexpr int stamp_radius_limit = 12;

int grid_columns(const Lab& lab) {
  const auto* grid = std::get_if<SiteGrid>(&lab.layout);
  return grid ? grid->columns : 0;
}

/// Calibration may move the bias, the read noise, the gain, the mean light and, where sites light the pixels
/// unevenly, its spread.
ExpectedCounts expected_counts(const CountLaw& law) {
  const double gain = law.em_gain / law.electrons_per_count, light = law.events_e + law.serial_events;
  const double below = 8 * law.read_noise_counts + 2;
  const double above = below + (12 + light + 6 * std::sqrt(light)) * gain;
  ExpectedCounts expected;
  expected.first = static_cast<int>(std::floor(law.bias_counts - below));
  const auto size = static_cast<int>(std::ceil(below + above));
  const int covered = static_cast<int>(std::bit_ceil(static_cast<unsigned>(std::clamp(size, 256, 1 << 16))));
  const auto probabilities = [&](const CountLaw& of) {
    std::vector<double> list = count_probabilities(of, expected.first, covered);
    list.resize(static_cast<std::size_t>(std::min(size, covered)));
    return list;
  };
  expected.probability = probabilities(law);
  const auto difference = [&](double CountLaw::*figure, double step) {
    CountLaw less = law, more = law;
    less.*figure -= step;
    more.*figure += step;
    const std::vector<double> low = probabilities(less);
    std::vector<double> slope = probabilities(more);
    for (std::size_t k = 0; k < slope.size(); ++k) slope[k] = (slope[k] - low[k]) / (2 * step);
    return slope;
  };
  constexpr double part = 0.01;
  expected.directions.push_back(difference(&CountLaw::bias_counts, part * law.read_noise_counts));
  expected.directions.push_back(difference(&CountLaw::read_noise_counts, part * law.read_noise_counts));
  expected.directions.push_back(difference(&CountLaw::em_gain, part * (law.em_gain - 1)));
  if (law.events_e > 0) {
    const double step = part * law.events_e;
    expected.directions.push_back(difference(&CountLaw::events_e, step));
    CountLaw spread = law;
    spread.events_spread = 0.05;
    std::vector<double> slope = probabilities(spread);
    for (std::size_t k = 0; k < slope.size(); ++k)
      slope[k] = (slope[k] - expected.probability[k]) / spread.events_spread;
    expected.directions.push_back(std::move(slope));
  }
  return expected;
}

/// Of a pixel without any light, where there is a register that multiplies.
std::optional<CountLaw> register_law(const Lab& lab, const StackModel& figures) {
  const auto* emccd = std::get_if<EmccdDescription>(&lab.sensor);
  if (!emccd) return std::nullopt;
  const CameraSettings& camera = lab.settings;
  const ReadoutMode& mode = emccd->readout_modes.at(static_cast<std::size_t>(camera.readout_mode));
  if (mode.amplifier != Amplifier::electron_multiplying || !(camera.em_gain > 1)) return std::nullopt;
  CountLaw law;
  law.bias_counts = figures.bias_counts;
  law.read_noise_counts = figures.read_noise_counts;
  law.electrons_per_count = mode.electrons_per_count;
  law.em_gain = camera.em_gain;
  law.stages = emccd->register_stages;
  if (const auto given = lab.effects.find("serial_cic"); given != lab.effects.end())
    law.serial_events = given->second.front();
  return law;
}

}  // namespace

StackModel stack_figures(const Lab& lab) {
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
    model.excess_noise = excess_noise_factor(gain, emccd->register_stages);
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
  return model;
}

StackModel stack_model(const Lab& lab, const PointSpreadFunction* known) {
  const CameraSettings& camera = lab.settings;
  StackModel model = stack_figures(lab);
  if (std::optional<CountLaw> law = register_law(lab, model)) {
    law->events_e = model.dark_e;
    model.expected_dark = expected_counts(*law);
    law->events_e += model.background_e;
    model.expected_light = expected_counts(*law);
  }
  model.site_light = PhotonImage(model.shape);

  const std::vector<Site>& sites = lab.scene.sites;
  if (sites.empty()) return model;
  std::optional<PointSpreadFunction> own;
  if (!known) own.emplace(lab.optics, 0, lab.scene.atom_extent_um);
  const PointSpreadFunction& point_spread = known ? *known : *own;
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

Leakage leakage(const StackModel& model, const PointSpreadFunction& point_spread,
                const std::vector<double>& site_variance_e2) {
  Leakage leaks;
  leaks.into.resize(model.sites.size());
  leaks.rest_variance.assign(model.shape.pixels(), 0.0);
  if (model.sites.empty()) return leaks;
  for (std::size_t t = 0; t < model.sites.size(); ++t) {
    const SiteImage& of = model.sites[t];
    // Twice a stamp and a half: light farther away is spread over many pixels.
    const int reach = 2 * stamp_radius_limit + stamp_radius_limit / 2;
    const int x = static_cast<int>(std::lround(of.x_px)), y = static_cast<int>(std::lround(of.y_px));
    const int left = std::clamp(x - reach, 0, model.shape.columns),
              top = std::clamp(y - reach, 0, model.shape.rows);
    const int right = std::clamp(x + reach + 1, left, model.shape.columns),
              bottom = std::clamp(y + reach + 1, top, model.shape.rows);
    if (left >= right || top >= bottom) continue;
    PhotonImage image({bottom - top, right - left});
    point_spread.add_expected(image, 1, of.x_px, of.y_px, left, top);
    PhotonImage rest = image;
    for (std::size_t s = 0; s < model.sites.size(); ++s) {
      const SiteImage& site = model.sites[s];
      const int rows = site.share.rows(), columns = site.share.columns();
      const int from_x = std::max(left, site.left), to_x = std::min(right, site.left + columns);
      const int from_y = std::max(top, site.top), to_y = std::min(bottom, site.top + rows);
      if (from_x >= to_x || from_y >= to_y) continue;
      double part = 0;
      for (int r = from_y; r < to_y; ++r)
        for (int c = from_x; c < to_x; ++c)
          part += static_cast<double>(site.weight(r - site.top, c - site.left)) *
                  static_cast<double>(image(r - top, c - left));
      for (int r = from_y; r < to_y; ++r)
        for (int c = from_x; c < to_x; ++c)
          rest(r - top, c - left) -= static_cast<float>(part) * site.share(r - site.top, c - site.left);
      if (s != t) leaks.into[s].push_back({t, part});
    }
    for (int r = top; r < bottom; ++r)
      for (int c = left; c < right; ++c) {
        const double off = rest(r - top, c - left);
        leaks
            .rest_variance[static_cast<std::size_t>(r) * model.shape.columns + static_cast<std::size_t>(c)] +=
            site_variance_e2[t] * off * off;
      }
  }
  return leaks;
}

std::vector<Surroundings> surroundings(const StackModel& model, const Leakage& leaks, double empty_variance) {
  const double second = model.excess_noise, f = model.filling;
  const double read_e = model.read_noise_counts / model.counts_per_electron;
  struct Case {
    double shift, variance;
  };
  std::vector<Case> cases;
  std::uint32_t bits = 0x2545f491;  // any fixed sequence: which neighbours are there
  const auto uniform = [&] {
    bits ^= bits << 13, bits ^= bits >> 17, bits ^= bits << 5;
    return bits * 0x1p-32;
  };
  const std::size_t draws = std::max<std::size_t>(2, 4000 / std::max<std::size_t>(1, model.sites.size()));
  for (std::size_t s = 0; s < model.sites.size(); ++s) {
    const SiteImage& site = model.sites[s];
    // What the neighbours would add to this site's variance, each by itself; those farther away on average.
    std::vector<double> adds(leaks.into[s].size(), 0.0);
    double base = 0;
    for (std::size_t n = 0; n < site.share.pixels().size(); ++n) {
      const int row = site.top + static_cast<int>(n) / site.share.columns(),
                column = site.left + static_cast<int>(n) % site.share.columns();
      const double w = site.weight.pixels()[n];
      double far =
          static_cast<double>(model.site_light(row, column)) - static_cast<double>(site.share.pixels()[n]);
      for (std::size_t k = 0; k < adds.size(); ++k) {
        const SiteImage& other = model.sites[leaks.into[s][k].site];
        const int r = row - other.top, c = column - other.left;
        if (r < 0 || c < 0 || r >= other.share.rows() || c >= other.share.columns()) continue;
        const double share = other.share(r, c);
        adds[k] += w * w * second * model.atom_e * share;
        far -= share;
      }
      base += w * w *
              (read_e * read_e +
               second * (model.background_e + model.dark_e + f * model.atom_e * std::max(0.0, far)));
    }
    for (std::size_t draw = 0; draw < draws; ++draw) {
      Case one{0, base};
      for (std::size_t k = 0; k < adds.size(); ++k) {
        const bool there = uniform() < f;
        one.variance += there ? adds[k] : 0;
        one.shift += leaks.into[s][k].part * model.atom_e * ((there ? 1 : 0) - f);
      }
      cases.push_back(one);
    }
  }
  std::sort(cases.begin(), cases.end(), [](const Case& a, const Case& b) { return a.variance < b.variance; });
  constexpr std::size_t classes = 6;
  std::vector<Surroundings> out;
  for (std::size_t k = 0; k < classes; ++k) {
    const std::size_t from = k * cases.size() / classes, to = (k + 1) * cases.size() / classes;
    if (from == to) continue;
    const double count = static_cast<double>(to - from);
    double shift = 0, variance = 0, spread = 0;
    for (std::size_t n = from; n < to; ++n)
      shift += cases[n].shift / count, variance += cases[n].variance / count;
    for (std::size_t n = from; n < to; ++n)
      spread += (cases[n].shift - shift) * (cases[n].shift - shift) / count;
    out.push_back({count / static_cast<double>(cases.size()), shift, (variance + spread) / empty_variance});
  }
  return out;
}

}  // namespace atomcam
