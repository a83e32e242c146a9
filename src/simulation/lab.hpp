#pragma once
// A laboratory: atoms, optics, sensor, set-points and effects; what a lab file says (TOML or JSON, same keys).

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/camera_settings.hpp"
#include "base/parameter.hpp"
#include "effects/effect.hpp"
#include "optics/optics.hpp"
#include "scene/scene.hpp"
#include "sensor/sensor.hpp"

namespace atomcam {

struct Lab {
  std::string name;
  std::string serial;                        // the sensor's serial number
  std::string user_name;
  std::uint64_t seed = 1;
  SceneDescription scene;                    // sites are filled from `grid` or `listed_sites`
  std::variant<SiteGrid, std::vector<Site>> layout;
  std::vector<Occupancy> given_occupancies;  // used in turn, one per shot, then repeated; empty: drawn
  OpticsDescription optics;
  double stray_light_photons_per_s = 0;      // per physical pixel, before quantum efficiency
  std::variant<EmccdDescription, QcmosDescription> sensor;
  CameraSettings settings;                   // set-points at power-up; overrides empty
  std::map<std::string, ParameterValues, std::less<>> effects;  // by name; absent = off

  CameraKind kind() const { return sensor.index() == 0 ? CameraKind::emccd : CameraKind::qcmos; }
  Shape sensor_shape() const;
  /// Recomputes scene.sites from the layout (after the layout, magnification or pixel size changed).
  void place_sites();
};

/// One scalar of a lab: its declaration (key with dots, "atoms.filling") and how to reach it. Reader, writer,
/// --set, camera overrides and SimulationControl features all come from this list.
struct LabParameter {
  ParameterDeclaration declaration;
  bool live = false;               // may change while the camera runs: becomes a SimulationControl feature
  std::string feature;             // GenICam name if live: "SimFilling"
  std::function<double(const Lab&)> get;
  std::function<void(Lab&, double)> set;
};
/// The scalars that a lab of this kind of camera has, the effects' parameters ("effects.row_noise.sigma_e") included.
std::span<const LabParameter> lab_parameters(CameraKind kind);

/// Sets one key from text ("atoms.filling", "0.6"; "effects.row_noise" = strength); checks range; nearest key in errors.
void set_parameter(Lab& lab, std::string_view key, std::string_view value, std::string_view place = "--set");
/// Sets one scalar by number, range checked; cheap enough for once per settings change.
void set_parameter(Lab& lab, std::string_view key, double value);

/// By extension .toml or .json; errors name file, key, value and what is allowed (unknown key: the nearest).
Lab read_lab(const std::filesystem::path& file);
/// `place` names the text in errors.
Lab parse_lab(std::string_view text, std::string_view place, bool json = false);
/// The lab as a TOML file: every key with its value; with comments (unit, range, meaning, source) if `commented`.
std::string write_lab(const Lab& lab, bool commented = false);

/// "ixon-ultra-897", "orca-quest": the camera's figures with the paper's experiment in front of it.
Lab preset(std::string_view name);
std::vector<std::string> preset_names();

}  // namespace atomcam
