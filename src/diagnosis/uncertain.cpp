#include "diagnosis/uncertain.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/math.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

using Figure = std::function<double(const Calibration&)>;

Uncertain relative(std::string name, double width, std::function<void(Lab&, double factor)> scale,
                   Figure figure) {
  return {.name = std::move(name),
          .centre = 0,
          .width = width,
          .lowest = -5 * width,
          .highest = 5 * width,
          .farthest = 3,  // a factor of twenty
          .apply = [scale](Lab& lab, double c) { scale(lab, std::exp(c)); },
          .value = [](double c) { return std::exp(c); },
          .offset =
              [figure](const Calibration& one, const Calibration& other) {
                const double a = figure(one), b = figure(other);
                return a > 0 && b > 0 ? std::clamp(std::log(a / b), -0.4, 0.4) : 0;
              }};
}
Uncertain shift(std::string name, double width, std::function<void(Lab&, double by)> add, Figure figure) {
  return {.name = std::move(name),
          .centre = 0,
          .width = width,
          .lowest = -5 * width,
          .highest = 5 * width,
          .apply = std::move(add),
          .value = [](double c) { return c; },
          .offset =
              [figure, most = 40 * width](const Calibration& one, const Calibration& other) {
                return std::clamp(figure(one) - figure(other), -most, most);
              }};
}

/// A part of a whole, in the coordinate in which counting leaves about the same error everywhere, its ends
/// included: the angle whose sine's square it is. There is nothing beyond the ends.
double angle_of(double part) {
  return std::asin(std::sqrt(std::clamp(part, 0.0, 1.0)));
}
Uncertain proportion(std::string name, double error, double calibrated, double SceneDescription::*part,
                     Figure figure) {
  constexpr double most_width = 0.12;
  const double at = angle_of(calibrated), quarter = 0.5 * math::pi;
  const double width =
      std::min(most_width, error / std::sin(2 * std::clamp(at, most_width, quarter - most_width)));
  Uncertain one = shift(
      std::move(name), width,
      [part, quarter](Lab& l, double by) {
        double& value = l.scene.*part;
        const double sine = std::sin(std::clamp(angle_of(value) + by, 0.0, quarter));
        value = sine * sine;
      },
      [figure](const Calibration& c) { return angle_of(figure(c)); });
  one.least = -at;
  one.most = quarter - at;
  return one;
}

/// How much the pixels of a qCMOS differ, in the coordinate in which it is measured about equally well
/// everywhere, zero included: its square. `usual`: the least width, as a part of the spread.
Uncertain spread_of(std::string name, double usual, double QcmosDescription::*spread,
                    const Calibration& calibration, Spread QcmosDarkFit::*measured) {
  const double at = std::pow(std::get<QcmosDescription>(calibration.lab.sensor).*spread, 2);
  constexpr double none = 1e-9;  // no dark frames, no spread
  Uncertain one = shift(
      std::move(name),
      std::max({2 * usual * at, 1.5 * (calibration.dark_maps.*measured).error_of_square, none}),
      [spread](Lab& l, double by) {
        double& value = std::get<QcmosDescription>(l.sensor).*spread;
        value = std::sqrt(std::max(0.0, value * value + by));
      },
      [measured](const Calibration& c) { return (c.dark_maps.*measured).square; });
  one.value = [at](double c) { return std::sqrt(std::max(0.0, at + c)); };
  one.least = -at;
  return one;
}

/// Dark current of a qCMOS, whose single electrons hide beside the read noise: no calibration says how many
/// there are, and data sheets are off by tens of percent.
Uncertain dark_current() {
  return relative(
      "dark_current", 0.25,
      [](Lab& l, double factor) { std::get<QcmosDescription>(l.sensor).dark_rate_e_per_s *= factor; },
      [](const Calibration&) { return 1.0; });
}

/// How unevenly the pixels have it, as the relative spread of the gamma law, 1 / sqrt(shape), over all that
/// sensors are known for: hardly, or nearly all of it in a few pixels (8).
Uncertain dark_current_spread() {
  constexpr double middle = 2.5, width = 2, least = 0.2, most = 8;
  Uncertain one = shift(
      "dark_current_spread", width,
      [=](Lab& l, double by) {
        const double spread = std::clamp(middle + by, least, most);
        std::get<QcmosDescription>(l.sensor).dark_gamma_shape = 1 / (spread * spread);
      },
      [](const Calibration&) { return 0.0; });
  one.value = [=](double c) { return middle + c; };
  one.lowest = one.least = least - middle;
  one.highest = one.most = most - middle;
  return one;
}

}  // namespace

bool Uncertain::is_of(const std::vector<std::string>& effects) const {
  return std::any_of(effects.begin(), effects.end(),
                     [&](const std::string& effect) { return name.starts_with("effects." + effect + "."); });
}

void Uncertain::calibrates_apart(double difference) {
  constexpr int enough = 2;
  constexpr double clearly = 3;  // usual widths
  if (scatters == 0) usual_width = width;
  scatter = (scatter * scatters + 0.5 * difference * difference) / (scatters + 1);
  ++scatters;
  if (scatters < enough) return;
  const double apart = std::sqrt(scatter);
  width = apart > clearly * usual_width ? apart : usual_width;
  move_to(centre);  // with its bounds
}

void Uncertain::move_to(double coordinate) {
  constexpr double bounds = 5;  // widths
  centre = std::clamp(std::clamp(coordinate, -farthest, farthest), least, most);
  lowest = centre - bounds * width;
  highest = centre + bounds * width;
}

double Uncertain::bounded(double coordinate) const {
  return cycle > 0 ? coordinate : std::clamp(coordinate, lowest, highest);
}

double Uncertain::within(double coordinate) const {
  if (cycle > 0) return coordinate - cycle * std::floor((coordinate - lowest) / cycle);
  return bounded(coordinate);
}

void Uncertain::make_room_at(double coordinate) {
  constexpr double room = 2;  // widths
  lowest = std::max(least, std::min(lowest, coordinate - room * width));
  highest = std::min(most, std::max(highest, coordinate + room * width));
}

std::vector<Uncertain> calibration_uncertainty(const Calibration& calibration) {
  std::vector<Uncertain> open;
  const Lab& lab = calibration.lab;
  const bool emccd = lab.kind() == CameraKind::emccd;
  const double bias_error = emccd ? calibration.counts.bias_error : calibration.dark_maps.bias_error;
  open.push_back(shift(
      "bias", std::max(0.004, 2 * bias_error), [](Lab& l, double by) { l.settings.bias_counts += by; },
      [](const Calibration& c) { return c.lab.settings.bias_counts; }));
  // Few dark frames leave more open than many.
  const auto width_of = [](double usual, double value, double error) {
    return value > 0 ? std::clamp(1.5 * error / value, usual, 10 * usual) : usual;
  };
  const QcmosDarkFit& maps = calibration.dark_maps;
  open.push_back(relative(
      "read_noise",
      emccd ? width_of(0.006, calibration.counts.law.read_noise_counts, calibration.counts.read_noise_error)
            : width_of(0.006, maps.read_noise_counts, maps.read_noise_error),
      [](Lab& l, double factor) {
        std::visit([&](auto& sensor) { sensor.readout_modes.front().read_noise_e *= factor; }, l.sensor);
      },
      [](const Calibration& c) { return c.model.read_noise_counts; }));
  // Few frames, or dark ones only, leave more open.
  const double gain_error =
      calibration.counts_per_electron_error / std::max(1e-12, calibration.model.counts_per_electron);
  open.push_back(relative(
      "electrons_per_count", std::clamp(1.5 * gain_error, 0.012, 0.15),
      [](Lab& l, double factor) {
        // The read noise is known in counts.
        std::visit(
            [&](auto& sensor) {
              sensor.readout_modes.front().electrons_per_count *= factor;
              sensor.readout_modes.front().read_noise_e *= factor;
            },
            l.sensor);
      },
      [](const Calibration& c) { return 1 / c.model.counts_per_electron; }));
  if (emccd)
    open.push_back(relative(
        "clock_induced_charge", 0.05,
        [](Lab& l, double factor) { std::get<EmccdDescription>(l.sensor).clock_induced_charge_e *= factor; },
        [](const Calibration& c) { return c.model.dark_e; }));
  if (calibration.model.background_e > 0)
    open.push_back(relative(
        "stray_light", 0.03, [](Lab& l, double factor) { l.stray_light_photons_per_s *= factor; },
        [](const Calibration& c) { return c.model.background_e; }));
  if (!emccd) {
    open.push_back(spread_of("pixel_offsets", 0.02, &QcmosDescription::offset_sigma_counts, calibration,
                             &QcmosDarkFit::offset_sigma_counts));
    open.push_back(spread_of("column_offsets", 0.15, &QcmosDescription::column_gumbel_counts, calibration,
                             &QcmosDarkFit::column_gumbel_counts));
    open.push_back(spread_of("row_offsets", 0.15, &QcmosDescription::row_offset_sigma_counts, calibration,
                             &QcmosDarkFit::row_offset_sigma_counts));
    open.push_back(spread_of("read_noise_spread", 0.08, &QcmosDescription::read_noise_log_sigma, calibration,
                             &QcmosDarkFit::read_noise_log_sigma));
  }
  if (!calibration.has_sites) return open;
  open.push_back(relative(
      "atom_light", 0.01, [](Lab& l, double factor) { l.scene.scattering_rate_hz *= factor; },
      [](const Calibration& c) { return c.model.atom_e; }));
  const AtomFit& atoms = calibration.atoms;
  open.push_back(proportion("filling", std::max(0.01, 1.5 * atoms.filling_error), atoms.filling,
                            &SceneDescription::filling,
                            [](const Calibration& c) { return c.lab.scene.filling; }));
  open.push_back(proportion("survival", std::max(0.002, 2 * atoms.survival_error), atoms.survival,
                            &SceneDescription::survival,
                            [](const Calibration& c) { return c.lab.scene.survival; }));
  for (const bool y : {false, true})
    open.push_back(shift(
        y ? "origin_y" : "origin_x", std::max(0.005, 2 * calibration.optics.position_error_px),
        [y](Lab& l, double by) {
          auto& grid = std::get<SiteGrid>(l.layout);
          (y ? grid.offset_y : grid.offset_x) += by;
        },
        [y](const Calibration& c) { return y ? c.optics.lattice.origin_y : c.optics.lattice.origin_x; }));
  // What makes the spots' centres shift across the field stretches or turns the lattice that is found.
  const Lattice& lattice = calibration.optics.lattice;
  const double across = 4 * std::max(0.003, calibration.optics.position_error_px);
  const double step_x = across / std::max(2, lattice.columns), step_y = across / std::max(2, lattice.rows);
  const double degrees = 180 / math::pi;
  open.push_back(shift(
      "spacing_x", step_x, [](Lab& l, double by) { std::get<SiteGrid>(l.layout).spacing_x += by; },
      [](const Calibration& c) { return std::hypot(c.optics.lattice.a_x, c.optics.lattice.a_y); }));
  open.push_back(shift(
      "spacing_y", step_y, [](Lab& l, double by) { std::get<SiteGrid>(l.layout).spacing_y += by; },
      [](const Calibration& c) { return std::hypot(c.optics.lattice.b_x, c.optics.lattice.b_y); }));
  open.push_back(shift(
      "angle_x", degrees * step_x / std::hypot(lattice.a_x, lattice.a_y),
      [](Lab& l, double by) { std::get<SiteGrid>(l.layout).angle_x_deg += by; },
      [degrees](const Calibration& c) {
        return degrees * std::atan2(c.optics.lattice.a_y, c.optics.lattice.a_x);
      }));
  open.push_back(shift(
      "angle_y", degrees * step_y / std::hypot(lattice.b_x, lattice.b_y),
      [](Lab& l, double by) { std::get<SiteGrid>(l.layout).angle_y_deg += by; },
      [degrees](const Calibration& c) {
        return degrees * std::atan2(-c.optics.lattice.b_x, c.optics.lattice.b_y);
      }));
  for (int term = 3; term < zernike_terms; ++term) {
    const auto row = static_cast<Eigen::Index>(3 + term);
    const double error =
        std::clamp(std::sqrt(std::max(0.0, calibration.optics.covariance(row, row))), 2e-5, 0.002);
    Uncertain one = shift(
        "zernike_" + std::string(zernike_catalogue()[term].key), 1.5 * error,
        [term](Lab& l, double by) { l.optics.zernike_um[term] += by; },
        [term](const Calibration& c) { return c.optics.zernike_um[static_cast<std::size_t>(term)]; });
    one.shared = true;
    open.push_back(std::move(one));
  }
  return open;
}

std::optional<Uncertain> register_uncertainty(const Calibration& calibration) {
  const auto* emccd = std::get_if<EmccdDescription>(&calibration.lab.sensor);
  if (!emccd || !(calibration.lab.settings.em_gain > 1) || !calibration.has_sites) return {};
  // The law of a gain and a number of stages is kept, so only a few numbers are drawn.
  Uncertain one = shift(
      "register_stages", 1.0 / 3,
      [](Lab& l, double c) {
        constexpr double step = 0.25, most_stages = 10000, largest_of_one = 1.2;
        const double inverse = 1 + std::clamp(step * std::round(c / step), -1.0, 1.0);
        int& stages = std::get<EmccdDescription>(l.sensor).register_stages;
        const double least = std::log(l.settings.em_gain) / std::log(largest_of_one);
        stages = static_cast<int>(
            std::clamp(stages / std::max(inverse, 1e-3), std::max(1.0, std::ceil(least)), most_stages));
      },
      [](const Calibration&) { return 0.0; });
  one.lowest = -1;
  one.highest = one.farthest = 1;
  return one;
}

std::vector<Uncertain> dark_current_uncertainty(const Calibration& calibration, double dark_pixels) {
  constexpr double few = 300;  // electrons
  const Lab& lab = calibration.lab;
  const auto* qcmos = std::get_if<QcmosDescription>(&lab.sensor);
  if (!qcmos || qcmos->dark_rate_e_per_s * lab.settings.exposure_s * dark_pixels < few) return {};
  return {dark_current(), dark_current_spread()};
}

std::vector<Uncertain> effect_prior(const EffectDeclaration& effect, double frame_px, double frames) {
  std::vector<Uncertain> open;
  constexpr double longest_period = 0.7;  // of the frame
  const bool in_image = effect.plane == Plane::scene || effect.plane == Plane::photons;
  const ParameterValues defaults = [&] {
    ParameterValues values;
    for (const ParameterDeclaration& p : effect.parameters) values.push_back(p.default_value);
    return values;
  }();
  for (std::size_t k = 0; k < effect.parameters.size(); ++k) {
    const ParameterDeclaration& p = effect.parameters[k];
    Uncertain one;
    one.name = "effects." + effect.name + "." + p.key;
    const bool strength = k == 0;
    // A second size in the strength's own unit: its order of magnitude is as unknown.
    const ParameterDeclaration& first = effect.parameters.front();
    const bool size = !strength && p.minimum == 0 && p.unit == first.unit && p.unit != "1";
    const bool logarithmic = strength || size || p.scale == ParameterScale::logarithmic;
    double low = p.minimum, most = p.maximum;
    if (in_image && p.unit == "px") {
      const double in_view = p.key.starts_with("period") ? longest_period * frame_px : frame_px;
      most = std::min(most, std::max(2 * p.minimum, in_view));
    }
    if (p.unit == "frames") most = std::min(most, std::max(2 * p.minimum, 2 * frames));
    double high = most;
    if (strength || size) {
      low = std::max(p.minimum, first.default_value / 20);
      // Thirty times the usual; three hundred times for a strength that is itself a multiple of the usual.
      // One that differs by orders of magnitude between cameras (not a part of something) may be whatever it
      // may.
      const bool multiple = first.unit == "1" && first.default_value == 1;
      const bool orders = first.unit != "1" && first.scale == ParameterScale::logarithmic;
      high = orders ? most : std::min(most, first.default_value * (multiple ? 300 : 30));
    } else if (logarithmic) {
      low = std::clamp(p.default_value / 20, p.minimum, std::max(p.minimum, most / 2));
      high = std::min(most, p.default_value * 20);
    }
    if (logarithmic) low = std::max(low, high * 1e-6);
    one.lowest = logarithmic ? std::log(low) : low;
    one.highest = logarithmic ? std::log(high) : high;
    one.least = !logarithmic ? p.minimum : p.minimum > 0 ? std::log(p.minimum) : one.lowest;
    one.most = logarithmic ? std::log(most) : most;
    one.centre = 0.5 * (one.lowest + one.highest);
    one.width = (one.highest - one.lowest) / std::sqrt(12.0);
    one.usual = std::clamp(logarithmic ? std::log(std::max(low, p.default_value)) : p.default_value,
                           one.lowest, one.highest);
    if (p.unit == "deg") one.cycle = p.maximum - p.minimum;
    one.value = [logarithmic, integer = p.integer](double c) {
      const double value = logarithmic ? std::exp(c) : c;
      return integer ? std::round(value) : value;
    };
    one.coordinate_of = [logarithmic, lowest = one.least](double value) {
      if (!logarithmic) return value;
      return value > 0 ? std::max(lowest, std::log(value)) : lowest;
    };
    one.apply = [name = effect.name, k, defaults, value = one.value, minimum = p.minimum,
                 maximum = p.maximum](Lab& l, double c) {
      auto& values = l.effects[name];
      if (values.empty()) values = defaults;
      values[k] = std::clamp(value(c), minimum, maximum);
    };
    open.push_back(std::move(one));
  }
  return open;
}

std::string stage_of(std::string_view effect) {
  const EffectDeclaration* declaration = find_effect(effect);
  if (!declaration) throw Error("effect", std::string(effect) + " is not in the catalogue");
  return std::string(declaration->stage());
}

}  // namespace atomcam
