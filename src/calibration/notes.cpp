#include "calibration/notes.hpp"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "base/error.hpp"

namespace atomcam {
namespace {

using Json = nlohmann::json;

Json json_of_toml(const std::string& text, const std::string& place) {
  try {
    const toml::table table = toml::parse(text, place);
    std::ostringstream out;
    out << toml::json_formatter{table};
    return Json::parse(out.str());
  } catch (const toml::parse_error& error) {
    throw Error(place, fmt::format("line {}: {}", error.source().begin.line, error.description()));
  }
}

bool contains_word(std::string text, std::string_view word) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text.find(word) != std::string::npos;
}

/// One table of the notes; what is asked for is ticked off, the rest is told.
class Table {
 public:
  Table(const Json& table, std::string place) : table_(table), place_(std::move(place)) {
    if (!table_.is_object()) throw Error(place_, "is not a table of keys and values");
  }
  const Json* find(const std::string& key) {
    asked_.insert(key);
    const auto found = table_.find(key);
    return found == table_.end() || found->is_null() ? nullptr : &*found;
  }
  void number(std::initializer_list<const char*> keys, double& value, double minimum, double maximum) {
    for (const char* key : keys)
      if (const Json* found = find(key)) {
        value = checked(*found, key, minimum, maximum);
        for (const char* other : keys) asked_.insert(other);
        return;
      }
  }
  double checked(const Json& value, const std::string& key, double minimum, double maximum) const {
    if (!value.is_number())
      throw Error(fmt::format("{}: {}", place_, key), fmt::format("is {}, must be a number", value.dump()));
    const double number = value.get<double>();
    if (!(number >= minimum && number <= maximum))
      throw Error(fmt::format("{}: {}", place_, key),
                  fmt::format("is {}, must lie from {} to {}", number, minimum, maximum));
    return number;
  }
  void tell_rest(std::vector<std::string>& rest) const {
    for (const auto& [key, value] : table_.items())
      if (!asked_.contains(key)) rest.push_back(key);
  }

 private:
  const Json& table_;
  std::string place_;
  std::set<std::string> asked_;
};

}  // namespace

Notes parse_notes(std::string_view text, std::string_view place, bool toml) {
  Notes notes;
  notes.place = place;
  Json root;
  if (toml) {
    root = json_of_toml(std::string(text), notes.place);
  } else {
    try {
      root = Json::parse(text);
    } catch (const Json::parse_error& error) {
      throw Error(notes.place, fmt::format("is not JSON: {}", error.what()));
    }
  }
  Table top(root, notes.place);
  top.find("remark");
  if (const Json* camera = top.find("camera")) {
    if (!camera->is_string()) throw Error(notes.place + ": camera", "must be a name in quotes");
    notes.camera = camera->get<std::string>();
  }
  const Json* shape = top.find("shape");
  if (shape) {
    if (!shape->is_array() || shape->size() < 2)
      throw Error(notes.place + ": shape", fmt::format("is {}, must be [rows, columns]", shape->dump()));
    const std::size_t skip = shape->size() - 2;  // [frames, rows, columns] is understood as well
    notes.shape.rows = static_cast<int>(top.checked((*shape)[skip], "shape", 1, 1 << 16));
    notes.shape.columns = static_cast<int>(top.checked((*shape)[skip + 1], "shape", 1, 1 << 16));
  }
  const Json* settings = top.find("settings");
  static const Json none = Json::object();
  Table table(settings ? *settings : none, notes.place + ": settings");
  const bool gain_noted = table.find("em_gain") != nullptr;
  if (gain_noted) notes.em_gain = table.checked(*table.find("em_gain"), "em_gain", 0, 5000);
  if (notes.em_gain < 1) notes.em_gain = 1;  // "0" is how some programs say off
  const bool emccd_name = contains_word(notes.camera, "ixon") || contains_word(notes.camera, "emccd") ||
                          contains_word(notes.camera, "du8") || contains_word(notes.camera, "em gain");
  const bool qcmos_name = contains_word(notes.camera, "orca") || contains_word(notes.camera, "cmos") ||
                          contains_word(notes.camera, "quest");
  notes.kind = emccd_name || (gain_noted && !qcmos_name) ? CameraKind::emccd : CameraKind::qcmos;
  if (notes.kind == CameraKind::qcmos) {
    notes.em_gain = 1;
    notes.electrons_per_count = 0.107;
    notes.pixel_um = 4.6;
  } else {
    notes.electrons_per_count = 5;
  }
  table.number({"exposure_s"}, notes.exposure_s, 0, 1e5);
  table.number({"frame_interval_s"}, notes.frame_interval_s, 0, 1e5);
  table.number({"preamp_e_per_adu", "electrons_per_count", "e_per_adu"}, notes.electrons_per_count, 1e-4,
               1e4);
  table.number({"bias_adu", "bias_counts", "offset_adu"}, notes.bias_counts, 0, 65535);
  table.number({"read_noise_adu", "read_noise_counts"}, notes.read_noise_counts, 0, 10000);
  table.number({"quantum_efficiency"}, notes.quantum_efficiency, 1e-3, 1);
  table.number({"dark_e_per_s"}, notes.dark_e_per_s, 0, 1e6);
  table.number({"cic_e", "clock_induced_charge_e"}, notes.clock_induced_charge_e, 0, 1e3);
  table.number({"pixel_um"}, notes.pixel_um, 0.1, 1000);
  table.number({"magnification"}, notes.magnification, 1e-3, 1e5);
  table.number({"numerical_aperture"}, notes.numerical_aperture, 1e-3, 0.9999);
  table.number({"wavelength_um"}, notes.wavelength_um, 0.05, 50);
  table.number({"transmission"}, notes.transmission, 1e-6, 1);
  table.number({"scattering_rate_hz"}, notes.scattering_rate_hz, 0, 1e12);
  table.number({"stray_e_per_s"}, notes.stray_e_per_s, 0, 1e9);
  table.number({"filling"}, notes.filling, 0, 1);
  table.number({"survival"}, notes.survival, 0, 1);
  table.number({"serial_cic", "serial_cic_events"}, notes.serial_cic_events, 0, 10);
  table.number({"row_noise_adu", "row_noise_counts"}, notes.row_noise_counts, 0, 1000);
  table.number({"flicker_noise_e"}, notes.flicker_noise_e, 0, 1000);
  table.find("temperature_c");
  table.tell_rest(notes.not_understood);

  if (const Json* grid = top.find("site_grid")) {
    Table sites(*grid, notes.place + ": site_grid");
    NotedGrid noted;
    double rows = 0, columns = 0;
    sites.number({"rows"}, rows, 0, 10000);
    sites.number({"cols", "columns"}, columns, 0, 10000);
    noted.rows = static_cast<int>(rows);
    noted.columns = static_cast<int>(columns);
    sites.number({"spacing_px"}, noted.spacing_px, 0, 1e4);
    sites.number({"angle_deg"}, noted.angle_deg, -360, 360);
    if (const Json* first = sites.find("first_site_px")) {
      if (!first->is_array() || first->size() != 2)
        throw Error(notes.place + ": site_grid: first_site_px",
                    fmt::format("is {}, must be [x, y]", first->dump()));
      noted.first_x_px = sites.checked((*first)[0], "first_site_px", -1e5, 1e5);
      noted.first_y_px = sites.checked((*first)[1], "first_site_px", -1e5, 1e5);
    }
    sites.tell_rest(notes.not_understood);
    if (noted.rows > 0 && noted.columns > 0) {
      if (noted.rows * noted.columns > 1 && !(noted.spacing_px > 0))
        throw Error(notes.place + ": site_grid: spacing_px", "must be above 0 for more than one site");
      notes.grid = noted;
    }
  }
  top.tell_rest(notes.not_understood);
  return notes;
}

Notes read_notes(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(file.string(), "cannot be read");
  std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  return parse_notes(text, file.string(), file.extension() == ".toml");
}

Lab lab_of_notes(const Notes& notes) {
  Lab lab = preset(notes.kind == CameraKind::emccd ? "ixon-ultra-897" : "orca-quest");
  lab.name = notes.camera.empty() ? lab.name : notes.camera;
  lab.effects.clear();
  lab.given_occupancies.clear();
  CameraSettings& camera = lab.settings;
  const double temperature_c = camera.sensor_temperature_c;  // the camera's own: not every one gets as cold
  camera = CameraSettings{};
  camera.sensor_temperature_c = temperature_c;
  camera.region = {0, 0, notes.shape.columns, notes.shape.rows};
  camera.exposure_s = notes.exposure_s;
  camera.frame_interval_s = notes.frame_interval_s > 0 ? notes.frame_interval_s : notes.exposure_s * 1.25;
  camera.bias_counts = notes.bias_counts;
  camera.em_gain = notes.em_gain;
  camera.defect_correction = false;
  ReadoutMode mode;
  mode.electrons_per_count = notes.electrons_per_count;
  mode.read_noise_e = notes.read_noise_counts * notes.electrons_per_count;
  if (auto* emccd = std::get_if<EmccdDescription>(&lab.sensor)) {
    emccd->shape = notes.shape;
    emccd->pixel_um = notes.pixel_um;
    emccd->quantum_efficiency = notes.quantum_efficiency;
    emccd->dark_rate_e_per_s = notes.dark_e_per_s;
    emccd->dark_reference_c = camera.sensor_temperature_c;
    emccd->clock_induced_charge_e = notes.clock_induced_charge_e;
    mode.amplifier = notes.em_gain > 1 ? Amplifier::electron_multiplying : Amplifier::conventional;
    mode.pixel_rate_hz = 1e6;
    mode.preamp = "1x";
    emccd->readout_modes = {mode};
    if (notes.serial_cic_events > 0) lab.effects["serial_cic"] = {notes.serial_cic_events};
  } else {
    auto& qcmos = std::get<QcmosDescription>(lab.sensor);
    qcmos.shape = notes.shape;
    qcmos.pixel_um = notes.pixel_um;
    qcmos.quantum_efficiency = notes.quantum_efficiency;
    qcmos.dark_rate_e_per_s = notes.dark_e_per_s;
    qcmos.dark_reference_c = camera.sensor_temperature_c;
    qcmos.offset_sigma_counts = qcmos.column_gumbel_counts = qcmos.row_offset_sigma_counts = 0;
    qcmos.gain_sigma = 0;
    qcmos.row_noise_e = notes.row_noise_counts * notes.electrons_per_count;
    qcmos.flicker_noise_e = notes.flicker_noise_e;
    mode.scan = ScanMode::standard;
    qcmos.readout_modes = {mode};
  }
  if (notes.kind == CameraKind::emccd && notes.row_noise_counts > 0)
    lab.effects["row_noise"] = {notes.row_noise_counts};
  OpticsDescription& optics = lab.optics;
  optics = OpticsDescription{};
  optics.wavelength_um = notes.wavelength_um;
  optics.numerical_aperture = notes.numerical_aperture;
  optics.magnification = notes.magnification;
  optics.pixel_um = notes.pixel_um;
  optics.transmission = notes.transmission;
  lab.stray_light_photons_per_s = notes.stray_e_per_s / notes.quantum_efficiency;
  SceneDescription& scene = lab.scene;
  scene = SceneDescription{};
  scene.scattering_rate_hz = notes.scattering_rate_hz;
  scene.filling = notes.filling;
  scene.survival = notes.survival;
  scene.reference_exposure_s = notes.exposure_s;
  if (notes.grid) {
    SiteGrid grid;
    grid.columns = notes.grid->columns;
    grid.rows = notes.grid->rows;
    grid.spacing_x = grid.spacing_y = notes.grid->spacing_px;
    grid.offset_x = notes.grid->first_x_px;
    grid.offset_y = notes.grid->first_y_px;
    grid.angle_x_deg = grid.angle_y_deg = notes.grid->angle_deg;
    lab.layout = grid;
  } else {
    lab.layout = std::vector<Site>{};
  }
  lab.place_sites();
  return lab;
}

void share_gain(Lab& lab) {
  static const double largest_gain =
      find_lab_parameter(CameraKind::emccd, "camera.em_gain")->declaration.maximum;
  auto* emccd = std::get_if<EmccdDescription>(&lab.sensor);
  if (!emccd || lab.settings.em_gain <= largest_gain) return;
  const double rest = lab.settings.em_gain / largest_gain;
  lab.settings.em_gain = largest_gain;
  for (ReadoutMode& mode : emccd->readout_modes) {
    mode.electrons_per_count /= rest;
    mode.read_noise_e /= rest;  // as many counts as before
  }
}

}  // namespace atomcam
