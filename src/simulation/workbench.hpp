#pragma once
// A lab that is changed and rendered in turns, as programs in other languages do: keys by name, a simulation
// when one is needed.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "simulation/simulation.hpp"

namespace atomcam {

/// A preset by its name, or a lab file.
Lab load_lab(const std::string& file_or_preset, std::string_view place = "lab");
/// As .toml with comments, or as .json.
void save_lab(const Lab& lab, const std::filesystem::path& file);

/// What a key holds; `allowed` in words for an error or a list.
struct KeyInfo {
  std::string key;
  std::string unit;  // "1" for a bare ratio; empty for a text
  std::string meaning;
  std::string allowed;
  std::string source;  // of the preset's value
  double minimum = 0, maximum = 0, default_value = 0;
  bool text = false, integer = false, boolean = false, logarithmic = false;
  bool live = false;  // may change while a camera runs
};
/// Every key of this lab in the order of a lab file, those of effects that are off included.
std::vector<KeyInfo> list_keys(const Lab& lab);

/// The same of an effect's parameter, under its short key.
KeyInfo describe(const ParameterDeclaration& declaration);

/// true or false, a whole number, a number, a text.
using KeyValue = std::variant<bool, std::int64_t, double, std::string>;
/// As a lab file and the command line have it.
std::string text_of(const KeyValue& value);

/// Sites in a list, instead of the grid or list that the lab had; given occupancies are dropped.
void set_sites(Lab& lab, std::vector<Site> sites);
/// Who is filled at the beginning of each shot, used in turn; none: drawn by chance.
void set_occupancies(Lab& lab, std::vector<Occupancy> occupancies);

/// The atoms, optics, light, seed and effects of the planes scene and photons of `lab`, seen by the camera of
/// `other`: its sensor with its serial number, its set-points and the effects of the planes behind the light.
Lab with_camera_of(const Lab& lab, const Lab& other);

/// Calls from several threads are safe; a simulation that was handed out stays as it is.
class Workbench {
 public:
  explicit Workbench(Lab lab) : lab_(std::move(lab)) {}
  Workbench(const Workbench& other) : lab_(other.lab()) {}

  Lab lab() const;
  /// "effects.row_noise" is its strength.
  KeyValue get(std::string_view key) const;
  /// What several keys decide together (region, binning, occupancy) is checked by simulation().
  void set(std::string_view key, const KeyValue& value);
  void set_text(std::string_view key, std::string_view value);
  void change(const std::function<void(Lab&)>& change);
  /// Of the lab as it is now; made when the lab has changed. Throws an Error if it is at odds with itself.
  std::shared_ptr<const Simulation> simulation() const;

 private:
  mutable std::mutex mutex_;
  Lab lab_;
  mutable std::shared_ptr<const Simulation> simulation_;
  mutable bool changed_ = true;
};

}  // namespace atomcam
