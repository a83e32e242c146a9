#pragma once
// A laboratory: atoms, optics, sensor, set-points and effects; what a lab file says (TOML or JSON, same
// keys).

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
  std::string serial;  // the sensor's serial number
  std::string user_name;
  std::uint64_t seed = 1;
  SceneDescription scene;  // sites are filled from `grid` or `listed_sites`
  std::variant<SiteGrid, std::vector<Site>> layout;
  std::vector<Occupancy> given_occupancies;  // used in turn, one per shot, then repeated; empty: drawn
  OpticsDescription optics;
  double stray_light_photons_per_s = 0;  // per physical pixel, before quantum efficiency
  std::variant<EmccdDescription, QcmosDescription> sensor;
  CameraSettings settings;                                      // set-points at power-up; overrides empty
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
  bool live = false;     // may change while the camera runs: becomes a SimulationControl feature
  std::string feature;   // GenICam name if live: "SimFilling"
  bool boolean = false;  // 0 or 1; false or true in a file
  std::function<double(const Lab&)> get;
  std::function<void(Lab&, double)> set;
  /// Whether a file of this lab holds the key (a grid has its spacing either in px or in um); empty: always.
  std::function<bool(const Lab&)> written;
};
/// The scalars that a lab of this kind of camera has, the effects' parameters ("effects.row_noise.sigma_e")
/// included.
std::span<const LabParameter> lab_parameters(CameraKind kind);
/// nullptr if this kind of camera has no such scalar.
const LabParameter* find_lab_parameter(CameraKind kind, std::string_view key);

/// What a lab says in words: names, and choices out of a table.
struct LabText {
  std::string key;
  std::string meaning;
  bool number = false;  // a number in a file, yet one out of a list ("camera.readout_rate_hz")
  std::function<std::vector<std::string>(const Lab&)> allowed;  // empty: free text
  std::function<std::string(const Lab&)> get;
  /// Throws an Error at `place` if the value is not allowed.
  std::function<void(Lab&, std::string_view value, std::string_view place)> set;
};
std::span<const LabText> lab_texts(CameraKind kind);

/// What no single key decides: the region fits the sensor and the binning, occupancies fit the sites, the
/// readout mode exists. Throws an Error at `place`. A lab that is read is checked; after set_parameter it is
/// up to the caller.
void check_lab(const Lab& lab, std::string_view place);

/// Sets one key from text ("atoms.filling", "0.6"; "effects.row_noise" = strength); checks range; nearest key
/// in errors.
void set_parameter(Lab& lab, std::string_view key, std::string_view value, std::string_view place = "--set");
/// Sets one scalar by number, range checked; cheap enough for once per settings change.
void set_parameter(Lab& lab, std::string_view key, double value);

/// By extension .toml or .json; errors name file, key, value and what is allowed (unknown key: the nearest).
Lab read_lab(const std::filesystem::path& file);
/// `place` names the text in errors.
Lab parse_lab(std::string_view text, std::string_view place, bool json = false);
/// The lab as a TOML file: every key with its value; with comments (unit, range, meaning, source) if
/// `commented`.
std::string write_lab(const Lab& lab, bool commented = false);
/// The same keys as JSON.
std::string write_lab_json(const Lab& lab);

/// "ixon-ultra-897", "orca-quest": the camera's figures with the paper's experiment in front of it.
Lab preset(std::string_view name);
std::vector<std::string> preset_names();
/// Where the preset's value of this key comes from; empty for a key without a figure. One that is not backed
/// by a source we saw ends in "(unverified)".
std::string_view figure_source(CameraKind kind, std::string_view key);
/// The same for row `mode` of the preset's readout modes.
std::string_view readout_mode_source(CameraKind kind, std::size_t mode);

}  // namespace atomcam
