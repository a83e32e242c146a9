#include "diagnosis/blind.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "calibration/notes.hpp"
#include "diagnosis/detection_strength.hpp"

namespace atomcam {
namespace {

class Draw {
 public:
  Draw(const char* of, std::uint64_t seed, std::uint64_t number) : random_(seed, stream_id(of), number, 0) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_()) + 0.5) * 0x1p-32;
  }
  double logarithmic(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
  std::size_t index(std::size_t count) {
    return std::min(count - 1, static_cast<std::size_t>(uniform(0, static_cast<double>(count))));
  }

 private:
  RandomStream random_;
};

struct Objective {
  double wavelength_um, numerical_aperture;
};
constexpr std::array<Objective, 3> objectives{{{0.461, 0.65}, {0.556, 0.6}, {0.78, 0.55}}};
constexpr std::array<double, 5> em_gains{100, 200, 300, 500, 900};
constexpr std::array<double, 3> preamps{4.85, 9.2, 15.5};  // electrons per count
constexpr std::array<double, 4> biases{100, 200, 300, 500};

/// Set-points as of other laboratories: atom, objective, exposure, gains, stray light, filling. An image of
/// an atom stays about as sharp in pixels, as it does where somebody chose the magnification.
void of_another_lab(Notes& notes, Draw& draw) {
  const double sharpness = notes.wavelength_um / notes.numerical_aperture;
  const Objective& objective = objectives[draw.index(objectives.size())];
  notes.wavelength_um = objective.wavelength_um;
  notes.numerical_aperture = objective.numerical_aperture;
  notes.magnification *=
      draw.uniform(0.85, 1.3) * sharpness * objective.numerical_aperture / objective.wavelength_um;
  notes.exposure_s = draw.logarithmic(0.02, 0.3);
  notes.stray_e_per_s *= draw.logarithmic(0.3, 4);
  notes.filling = draw.uniform(0.35, 0.9);
  notes.bias_counts = biases[draw.index(biases.size())];
  if (notes.kind != CameraKind::emccd) return;
  notes.em_gain = em_gains[draw.index(em_gains.size())];
  notes.electrons_per_count = preamps[draw.index(preamps.size())];
}

Notes set_points(bool emccd, const BlindOptions& options, Draw& draw, Draw& other) {
  Notes notes;
  notes.place = "blind";
  notes.camera = emccd ? "iXon Ultra 897" : "ORCA-Quest";
  notes.kind = emccd ? CameraKind::emccd : CameraKind::qcmos;
  notes.shape = {options.rows, options.columns};
  notes.exposure_s = 0.08;
  notes.em_gain = emccd ? 300 : 1;
  notes.electrons_per_count = emccd ? 4.85 : 0.107;
  notes.read_noise_counts = 4;
  notes.quantum_efficiency = emccd ? 0.86 : 0.85;
  notes.dark_e_per_s = emccd ? 3e-4 : 0.006;
  notes.clock_induced_charge_e = emccd ? 0.002 : 0;
  notes.pixel_um = emccd ? 16 : 4.6;
  notes.magnification = emccd ? 78.125 : 30;
  notes.scattering_rate_hz = 30000;
  notes.stray_e_per_s = emccd ? 2 : 4;
  notes.filling = 0.55;
  notes.survival = 0.97;
  NotedGrid grid;
  grid.spacing_px = draw.uniform(9, 11.5);
  if (options.any_lab) {
    of_another_lab(notes, other);
    grid.spacing_px = other.uniform(7, 16);
  }
  const auto fitting = [&](int pixels) {
    const int left_out = options.any_lab ? static_cast<int>(other.index(4)) : 0;
    return std::max(2, static_cast<int>((pixels - 22) / grid.spacing_px) + 1 - left_out);
  };
  grid.rows = fitting(options.rows);
  grid.columns = fitting(options.columns);
  grid.first_x_px = 0.5 * (options.columns - 1 - (grid.columns - 1) * grid.spacing_px);
  grid.first_y_px = 0.5 * (options.rows - 1 - (grid.rows - 1) * grid.spacing_px);
  notes.grid = grid;
  return notes;
}

std::string notes_text(const Notes& notes) {
  nlohmann::ordered_json json;
  json["camera"] = notes.camera;
  json["shape"] = {notes.shape.rows, notes.shape.columns};
  auto& settings = json["settings"];
  settings["quantum_efficiency"] = notes.quantum_efficiency;
  settings["exposure_s"] = notes.exposure_s;
  if (notes.kind == CameraKind::emccd) settings["em_gain"] = notes.em_gain;
  settings["preamp_e_per_adu"] = notes.electrons_per_count;
  settings["bias_adu"] = notes.bias_counts;
  settings["read_noise_adu"] = notes.read_noise_counts;
  settings["dark_e_per_s"] = notes.dark_e_per_s;
  if (notes.kind == CameraKind::emccd) settings["cic_e"] = notes.clock_induced_charge_e;
  settings["pixel_um"] = notes.pixel_um;
  settings["magnification"] = notes.magnification;
  settings["numerical_aperture"] = notes.numerical_aperture;
  settings["wavelength_um"] = notes.wavelength_um;
  settings["scattering_rate_hz"] = notes.scattering_rate_hz;
  settings["stray_e_per_s"] = notes.stray_e_per_s;
  settings["filling"] = notes.filling;
  settings["survival"] = notes.survival;
  json["site_grid"] = {
      {"rows", notes.grid->rows},
      {"cols", notes.grid->columns},
      {"spacing_px", std::round(100 * notes.grid->spacing_px) / 100},
      {"first_site_px",
       {std::round(10 * notes.grid->first_x_px) / 10, std::round(10 * notes.grid->first_y_px) / 10}},
      {"angle_deg", 0.0}};
  return json.dump(1);
}

/// The effects to choose among that make sense on this camera.
std::vector<const EffectDeclaration*> effects_on(CameraKind kind, const BlindOptions& options) {
  std::vector<const EffectDeclaration*> list;
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (!effect.on(kind)) continue;
    if (!options.effects.empty() &&
        std::find(options.effects.begin(), options.effects.end(), effect.name) == options.effects.end())
      continue;
    list.push_back(&effect);
  }
  return list;
}

}  // namespace

BlindStack make_blind_stack(const BlindOptions& options, std::uint64_t number) {
  Draw draw("blind", options.seed, number), other("blind lab", options.seed, number);
  bool emccd = draw.uniform(0, 1) < 0.5;
  const auto kind_of = [](bool is_emccd) { return is_emccd ? CameraKind::emccd : CameraKind::qcmos; };
  if (effects_on(kind_of(emccd), options).empty()) emccd = !emccd;
  const Notes notes = set_points(emccd, options, draw, other);
  BlindStack stack;
  stack.notes = notes_text(notes);
  Lab& lab = stack.lab;
  lab = lab_of_notes(notes);
  lab.seed = options.seed * 7919 + number;
  lab.serial = std::to_string(100000 + number);
  // What the notes do not know: every figure some percent off.
  lab.settings.bias_counts += draw.uniform(-3, 3);
  lab.settings.em_gain *= emccd ? draw.uniform(0.8, 1.2) : 1;
  std::visit(
      [&](auto& sensor) {
        ReadoutMode& mode = sensor.readout_modes.front();
        if (!emccd) mode.electrons_per_count *= draw.uniform(0.92, 1.08);
        mode.read_noise_e *= draw.uniform(0.9, 1.15);
        sensor.dark_rate_e_per_s *= draw.uniform(0.7, 1.4);
      },
      lab.sensor);
  if (auto* sensor = std::get_if<EmccdDescription>(&lab.sensor)) {
    sensor->clock_induced_charge_e *= draw.uniform(0.7, 1.4);
  } else {
    auto& qcmos = std::get<QcmosDescription>(lab.sensor);
    qcmos.offset_sigma_counts = draw.uniform(0.4, 0.8);
    qcmos.column_gumbel_counts = draw.uniform(0.05, 0.2);
    qcmos.row_offset_sigma_counts = draw.uniform(0.05, 0.2);
    qcmos.read_noise_log_sigma = draw.uniform(0.03, 0.1);
  }
  lab.scene.scattering_rate_hz *= draw.uniform(0.8, 1.3);
  lab.stray_light_photons_per_s *= draw.uniform(0.7, 1.6);
  lab.scene.filling = std::min(0.97, notes.filling + draw.uniform(-0.1, 0.13));
  lab.scene.survival = draw.uniform(0.93, 0.995);
  auto& grid = std::get<SiteGrid>(lab.layout);
  grid.offset_x += draw.uniform(-0.8, 0.8);
  grid.offset_y += draw.uniform(-0.8, 0.8);
  grid.angle_x_deg = grid.angle_y_deg = draw.uniform(-0.5, 0.5);
  lab.optics.zernike_um[3] = draw.uniform(options.any_lab ? 0 : 0.02, 0.07);
  for (int term = 4; term < zernike_terms; ++term) lab.optics.zernike_um[term] = draw.uniform(-0.015, 0.015);

  std::vector<const EffectDeclaration*> known = effects_on(kind_of(emccd), options);
  const double lot = draw.uniform(0, 1);
  const int count = lot < options.none_share ? 0 : lot > 1 - options.pair_share ? 2 : 1;
  lab.place_sites();
  std::unique_ptr<DetectionGround> ground;
  if (options.of_detection && count > 0)
    ground = std::make_unique<DetectionGround>(lab, parse_notes(stack.notes, "blind"), options.frames,
                                               options.darks, options.threads);
  for (int k = 0; k < count && !known.empty();) {
    const std::size_t which = draw.index(known.size());
    const EffectDeclaration& effect = *known[which];
    known.erase(known.begin() + static_cast<std::ptrdiff_t>(which));
    ParameterValues values;
    double multiple = 1;
    for (const ParameterDeclaration& p : effect.parameters) {
      double value = p.default_value;
      if (p.unit == "deg")
        value = draw.uniform(p.minimum, p.maximum);
      else if (values.empty())
        value *= multiple = draw.logarithmic(options.weakest, options.strongest);
      else if (p.scale == ParameterScale::logarithmic)
        value *= draw.logarithmic(0.7, 1.4);
      values.push_back(std::clamp(value, p.minimum, p.maximum));
      if (p.integer) values.back() = std::round(values.back());
    }
    BlindEffect sealed{effect.name, std::string(effect.stage())};
    if (ground) {
      const DetectionStrength seen = ground->of(effect, values);
      const double most = effect.parameters.front().maximum;
      if (!seen.reached || multiple * seen.strength > most) continue;  // another one
      sealed.detection_strength = seen.strength;
      sealed.matched_filter = seen.matched_filter;
      values.front() = multiple * seen.strength;
    }
    sealed.strength = values.front();
    stack.effects.push_back(sealed);
    lab.effects[effect.name] = values;
    ++k;
  }
  check_lab(lab, "blind");
  return stack;
}

}  // namespace atomcam
