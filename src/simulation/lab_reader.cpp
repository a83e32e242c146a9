// The walker: a tree, from TOML or JSON alike, onto a lab.

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <set>

#include <fmt/format.h>

#include "base/error.hpp"
#include "simulation/lab.hpp"
#include "simulation/lab_choice.hpp"
#include "simulation/lab_set.hpp"
#include "simulation/lab_text_form.hpp"
#include "simulation/lab_tree.hpp"

namespace atomcam {
namespace {

constexpr std::uintmax_t largest_file = 64u << 20;

std::string read_text(const std::filesystem::path& file, std::string_view place) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) throw Error(place, "no such file");
  if (std::filesystem::is_directory(status)) throw Error(place, "is a directory; allowed a file");
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw Error(place, fmt::format("cannot be read: {}", std::strerror(errno)));
  std::string text;
  char buffer[1 << 16];
  while (stream.read(buffer, sizeof buffer) || stream.gcount() > 0) {
    text.append(buffer, static_cast<std::size_t>(stream.gcount()));
    if (text.size() > largest_file) throw Error(place, "is larger than 64 MiB");
  }
  if (stream.bad()) throw Error(place, "cannot be read");
  return text;
}

class Walker {
 public:
  Walker(std::string_view place, std::filesystem::path folder) : file_(place), folder_(std::move(folder)) {}

  Lab read(const Tree& tree) {
    if (tree.kind != Tree::Kind::table) fail(tree, "", tree.what() + " instead of a table of keys");
    lab_ = preset(preset_name(tree));
    collect(tree, "");
    read_sensor_table();
    // What others depend on comes first: the sensor's size and the magnification carry the sites and the
    // region.
    for (const char* prefix : {"sensor.", "optics."}) assign_scalars(prefix);
    fit_region_to_sensor();
    assign_scalars("");
    assign_texts();
    read_readout();
    read_sites();
    lab_.place_sites();
    read_occupancies();
    check_lab(lab_, file_);
    return std::move(lab_);
  }

 private:
  std::string place(const Tree& tree, std::string_view key) const {
    std::string text = tree.line > 0 ? fmt::format("{}:{}", file_, tree.line) : file_;
    if (!key.empty()) text += fmt::format(": {}", key);
    return text;
  }
  [[noreturn]] void fail(const Tree& tree, std::string_view key, const std::string& problem) const {
    throw Error(place(tree, key), problem);
  }

  std::string preset_name(const Tree& tree) const {
    for (const auto& [key, camera] : tree.members) {
      if (key != "camera" || camera.kind != Tree::Kind::table) continue;
      for (const auto& [inner, value] : camera.members) {
        if (inner != "preset") continue;
        const std::vector<std::string> names = preset_names();
        if (value.kind != Tree::Kind::text ||
            std::find(names.begin(), names.end(), value.text) == names.end()) {
          fail(value, "camera.preset",
               fmt::format("{}; allowed '{}'", value.what(), fmt::join(names, "', '")) +
                   (value.kind == Tree::Kind::text ? "; the nearest is '" + nearest(value.text, names) + "'"
                                                   : ""));
        }
        return value.text;
      }
    }
    return preset_names().front();
  }

  static std::string nearest(std::string_view word, const std::vector<std::string>& known) {
    return nearest_word(word.substr(0, 100), known);
  }

  // -- which keys there are
  // -------------------------------------------------------------------------------------

  /// Keys that are not scalars; lists whose entries the reader knows itself.
  static bool is_list(std::string_view key) {
    return key == "atoms.site" || key == "atoms.occupancy" || key == "sensor.readout_mode";
  }
  static bool is_word(std::string_view key) {
    return key == "camera.preset" || key == "atoms.occupancy_file";
  }

  /// Names that may stand in the table `path` ("" or "camera."), in order.
  std::vector<std::string> names_in(const std::string& path) const {
    std::vector<std::string> names;
    const auto add = [&](std::string_view key) {
      if (!key.starts_with(path)) return;
      const std::string_view rest = key.substr(path.size());
      const std::string name(rest.substr(0, rest.find('.')));
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    };
    for (const std::string& key : lab_keys(lab_.kind())) add(key);
    for (const char* key :
         {"camera.preset", "atoms.occupancy", "atoms.occupancy_file", "atoms.site", "sensor.readout_mode"}) {
      add(key);
    }
    return names;
  }

  [[noreturn]] void fail_unknown(const Tree& tree, const std::string& path, const std::string& name) const {
    constexpr std::size_t longest = 100;
    const std::string where = place(tree, "");
    if (name.size() > longest) throw Error(where, "unknown key " + in_quotes(path + name));
    const CameraKind other = lab_.kind() == CameraKind::emccd ? CameraKind::qcmos : CameraKind::emccd;
    for (const std::string& key : lab_keys(other)) {
      if (key == path + name || key.starts_with(path + name + ".")) {
        throw Error(where, fmt::format("{} does not exist on {}", in_quotes(path + name),
                                       other == CameraKind::qcmos ? "an EMCCD" : "a qCMOS"));
      }
    }
    for (const std::string& key : lab_keys(lab_.kind())) {  // right key, wrong table
      if (key.ends_with("." + name)) {
        throw Error(where, fmt::format("unknown key {}; the nearest is '{}'", in_quotes(path + name), key));
      }
    }
    throw Error(where, fmt::format("unknown key {}; the nearest is '{}'", in_quotes(path + name),
                                   path + nearest_word(name, names_in(path))));
  }

  void collect(const Tree& table, const std::string& path) {
    const std::vector<std::string> names = names_in(path);
    for (const auto& [name, member] : table.members) {
      if (std::find(names.begin(), names.end(), name) == names.end()) fail_unknown(member, path, name);
      const std::string key = path + name;
      if (is_list(key) || is_word(key) || is_leaf(key)) {
        given_.emplace(key, &member);
      } else if (member.kind == Tree::Kind::table) {
        if (path == "effects.") switch_on(name);
        collect(member, key + ".");
      } else if (path == "effects." && member.kind == Tree::Kind::number) {
        set_parameter_here(member, key, member.number);  // the strength alone
      } else {
        fail(member, key,
             fmt::format("{} instead of a table{}", member.what(), path == "effects." ? " or a number" : ""));
      }
    }
  }

  bool is_leaf(const std::string& key) const {
    const auto& keys = lab_keys(lab_.kind());
    return std::find(keys.begin(), keys.end(), key) != keys.end();
  }

  /// An effect with a table in the file starts from its declared defaults, or the preset's.
  void switch_on(const std::string& name) {
    if (lab_.effects.contains(name)) return;
    ParameterValues values;
    for (const ParameterDeclaration& parameter : find_effect(name)->parameters) {
      values.push_back(parameter.default_value);
    }
    lab_.effects.emplace(name, std::move(values));
  }

  // -- scalars
  // --------------------------------------------------------------------------------------------------

  void set_parameter_here(const Tree& tree, const std::string& key, double value) {
    const LabParameter* parameter = find_lab_parameter(lab_.kind(), key);
    const std::string where = place(tree, key);
    if (!parameter) {  // an effect's name
      const std::string strength = key + "." + find_effect(key.substr(8))->parameters.at(0).key;
      parameter = find_lab_parameter(lab_.kind(), strength);
    }
    check_value(parameter->declaration, value, where);
    parameter->set(lab_, value);
  }

  void assign_scalars(std::string_view prefix) {
    read_grid_keys();
    for (const auto& [key, tree] : given_) {
      if (!key.starts_with(prefix) || key.starts_with("atoms.grid.") || done_.contains(key)) continue;
      const LabParameter* parameter = find_lab_parameter(lab_.kind(), key);
      if (!parameter) continue;
      assign(*parameter, *tree, key);
      done_.insert(key);
    }
  }

  void assign(const LabParameter& parameter, const Tree& tree, const std::string& key) {
    if (parameter.boolean) {
      if (tree.kind != Tree::Kind::boolean) fail(tree, key, tree.what() + "; allowed true or false");
      parameter.set(lab_, tree.boolean ? 1 : 0);
    } else {
      if (tree.kind != Tree::Kind::number) {
        fail(tree, key,
             fmt::format("{} instead of a number; allowed {}", tree.what(),
                         allowed_text(parameter.declaration)));
      }
      set_parameter_here(tree, key, tree.number);
    }
  }

  void assign_texts() {
    for (const LabText& text : lab_texts(lab_.kind())) {
      const auto found = given_.find(text.key);
      if (found == given_.end()) continue;
      const std::string value = word(*found->second, text.key, text.number);
      if (text.key != "camera.amplifier" && text.key != "camera.readout_rate_hz" &&
          text.key != "camera.preamp" && text.key != "camera.scan") {
        text.set(lab_, value, place(*found->second, text.key));
      }
    }
  }

  std::string word(const Tree& tree, std::string_view key, bool number = false) const {
    if (tree.kind != (number ? Tree::Kind::number : Tree::Kind::text)) {
      fail(tree, key, fmt::format("{} instead of {}", tree.what(), number ? "a number" : "a text"));
    }
    return number ? number_text(tree.number) : tree.text;
  }

  /// A sensor of another size is read in full unless the file says which part.
  void fit_region_to_sensor() {
    const auto given = [this](const char* key) { return given_.contains(std::string("camera.") + key); };
    if (given("offset_x_px") || given("offset_y_px") || given("width_px") || given("height_px")) return;
    const Shape shape = lab_.sensor_shape();
    for (const char* key : {"binning_x", "binning_y"}) {
      const auto found = given_.find(std::string("camera.") + key);
      if (found == given_.end()) continue;
      assign(*find_lab_parameter(lab_.kind(), found->first), *found->second, found->first);
    }
    const CameraSettings& settings = lab_.settings;
    lab_.settings.region = {0, 0, shape.columns - shape.columns % settings.binning_x,
                            shape.rows - shape.rows % settings.binning_y};
  }

  // -- the sensor's readout modes
  // -------------------------------------------------------------------------------

  /// Members of one entry of a list, each of them named in `known`.
  std::map<std::string, const Tree*> entry(const Tree& tree, const std::string& key,
                                           const std::vector<std::string>& known) const {
    if (tree.kind != Tree::Kind::table) fail(tree, key, tree.what() + " instead of a table");
    std::map<std::string, const Tree*> members;
    for (const auto& [name, member] : tree.members) {
      if (std::find(known.begin(), known.end(), name) == known.end()) {
        throw Error(place(member, ""), fmt::format("unknown key {}; the nearest is '{}.{}'",
                                                   in_quotes(key + "." + name), key, nearest(name, known)));
      }
      members.emplace(name, &member);
    }
    return members;
  }

  double number_of(const std::map<std::string, const Tree*>& members, const Tree& tree,
                   const std::string& key, const std::string& name, double minimum, double maximum,
                   std::optional<double> otherwise = std::nullopt) const {
    const auto found = members.find(name);
    if (found == members.end()) {
      if (otherwise) return *otherwise;
      fail(tree, key, fmt::format("'{}' is missing", name));
    }
    ParameterDeclaration declaration;
    declaration.unit = "1";
    declaration.minimum = minimum;
    declaration.maximum = maximum;
    if (found->second->kind != Tree::Kind::number) {
      fail(*found->second, key + "." + name,
           fmt::format("{} instead of a number; allowed {}", found->second->what(),
                       allowed_text(declaration)));
    }
    check_value(declaration, found->second->number, place(*found->second, key + "." + name));
    return found->second->number;
  }

  std::string word_of(const std::map<std::string, const Tree*>& members, const Tree& tree,
                      const std::string& key, const std::string& name,
                      const std::vector<std::string>& allowed) const {
    const auto found = members.find(name);
    if (found == members.end()) fail(tree, key, fmt::format("'{}' is missing", name));
    const std::string value = word(*found->second, key + "." + name);
    if (allowed.empty() ? value.empty() || value.size() > 15 || !is_valid_utf8(value)
                        : std::find(allowed.begin(), allowed.end(), value) == allowed.end()) {
      fail(*found->second, key + "." + name,
           fmt::format("value {}; allowed {}", in_quotes(value),
                       allowed.empty() ? "1 to 15 characters" : fmt::format("{}", fmt::join(allowed, ", "))));
    }
    return value;
  }

  void read_sensor_table() {
    const std::string key = "sensor.readout_mode";
    const auto found = given_.find(key);
    if (found == given_.end()) return;
    const Tree& list = *found->second;
    if (list.kind != Tree::Kind::array || list.items.empty()) {
      fail(list, key, list.what() + "; allowed a list of at least one table");
    }
    const bool emccd = lab_.kind() == CameraKind::emccd;
    const std::vector<std::string> known =
        emccd ? std::vector<std::string>{"amplifier", "readout_rate_hz", "preamp", "electrons_per_count",
                                         "read_noise_e"}
              : std::vector<std::string>{"scan", "electrons_per_count", "read_noise_e"};
    std::vector<ReadoutMode> modes;
    for (const Tree& item : list.items) {
      const auto members = entry(item, key, known);
      ReadoutMode mode;
      mode.amplifier = Amplifier::conventional;
      if (emccd) {
        if (word_of(members, item, key, "amplifier", {"electron_multiplying", "conventional"}) !=
            "conventional") {
          mode.amplifier = Amplifier::electron_multiplying;
        }
        mode.pixel_rate_hz = number_of(members, item, key, "readout_rate_hz", 1e3, 1e9);
        mode.preamp = word_of(members, item, key, "preamp", {});
      } else if (word_of(members, item, key, "scan", {"standard", "ultra_quiet"}) != "standard") {
        mode.scan = ScanMode::ultra_quiet;
      }
      for (const ReadoutFigure& figure : readout_figures()) {
        const ParameterDeclaration& declared = figure.declaration;
        mode.*figure.member = number_of(members, item, key, declared.key, declared.minimum, declared.maximum);
      }
      for (const ReadoutMode& other : modes) {
        if (readout_mode_name(lab_.kind(), other) == readout_mode_name(lab_.kind(), mode)) {
          fail(item, key, fmt::format("{} twice", in_quotes(readout_mode_name(lab_.kind(), mode))));
        }
      }
      modes.push_back(std::move(mode));
    }
    // The mode of power-up stays the one that it was if the new table has it, else its first.
    const auto& before = std::visit(
        [](auto& sensor) -> std::vector<ReadoutMode>& { return sensor.readout_modes; }, lab_.sensor);
    const std::string now = readout_mode_name(lab_.kind(), before.at(lab_.settings.readout_mode));
    lab_.settings.readout_mode = 0;
    for (std::size_t i = 0; i < modes.size(); ++i) {
      if (readout_mode_name(lab_.kind(), modes[i]) == now) lab_.settings.readout_mode = static_cast<int>(i);
    }
    std::visit([&](auto& sensor) { sensor.readout_modes = std::move(modes); }, lab_.sensor);
  }

  void read_readout() {
    ReadoutWish wish;
    const Tree* last = nullptr;
    const auto take = [&](const char* name, std::optional<std::string>& part, bool number = false) {
      const auto found = given_.find(std::string("camera.") + name);
      if (found == given_.end()) return;
      last = found->second;
      part = word(*last, found->first, number);
    };
    if (lab_.kind() == CameraKind::emccd) {
      take("amplifier", wish.amplifier);
      take("readout_rate_hz", wish.rate_hz, true);
      take("preamp", wish.preamp);
    } else {
      take("scan", wish.scan);
    }
    if (last)
      choose_readout_mode(lab_, wish,
                          place(*last, lab_.kind() == CameraKind::emccd ? "camera" : "camera.scan"));
  }

  // -- sites
  // ----------------------------------------------------------------------------------------------------

  void read_grid_keys() {
    if (grid_checked_) return;
    grid_checked_ = true;
    const Tree* um = nullptr;
    for (const auto& [key, tree] : given_) {
      if (key.starts_with("atoms.grid.") && key.ends_with("_um")) um = tree;
    }
    for (const auto& [key, tree] : given_) {
      if (!key.starts_with("atoms.grid.")) continue;
      if (um && key.ends_with("_px")) {
        fail(*tree, key,
             fmt::format("in px, but another length of the grid is in um (line {}); allowed one of them",
                         um->line));
      }
      if (given_.contains("atoms.site"))
        fail(*tree, key, "a grid beside a list of sites; allowed one of them");
    }
  }

  void read_sites() {
    for (const auto& [key, tree] : given_) {
      if (!key.starts_with("atoms.grid.")) continue;
      assign(*find_lab_parameter(lab_.kind(), key), *tree, key);
    }
    const std::string key = "atoms.site";
    const auto found = given_.find(key);
    if (found == given_.end()) return;
    const Tree& list = *found->second;
    if (list.kind != Tree::Kind::array) fail(list, key, list.what() + " instead of a list of tables");
    std::vector<Site> sites;
    for (const Tree& item : list.items) {
      const auto members = entry(item, key, {"x_px", "y_px", "brightness"});
      Site site;
      site.x_px = number_of(members, item, key, "x_px", -1e5, 1e5);
      site.y_px = number_of(members, item, key, "y_px", -1e5, 1e5);
      site.brightness = number_of(members, item, key, "brightness", 0, 1e6, 1.0);
      sites.push_back(site);
    }
    lab_.layout = std::move(sites);
  }

  Occupancy occupancy(const Tree& tree, std::string_view key, std::string_view digits) const {
    Occupancy filled;
    for (const char digit : digits) {
      if (digit == '0' || digit == '1') {
        filled.push_back(digit == '1');
      } else if (digit != ' ' && digit != '\t' && digit != '\r' && digit != '\n') {
        fail(tree, key,
             fmt::format("value {}; allowed the digits 0 and 1, one for each site, and blanks",
                         in_quotes(digits)));
      }
    }
    if (filled.size() != lab_.scene.sites.size()) {
      fail(tree, key,
           fmt::format("{} digits; allowed one for each of the {} sites", filled.size(),
                       lab_.scene.sites.size()));
    }
    return filled;
  }

  void read_occupancies() {
    const auto list = given_.find("atoms.occupancy");
    const auto file = given_.find("atoms.occupancy_file");
    if (list != given_.end()) {
      const Tree& tree = *list->second;
      if (file != given_.end()) fail(tree, list->first, "beside occupancy_file; allowed one of them");
      if (tree.kind != Tree::Kind::array)
        fail(tree, list->first, tree.what() + " instead of a list of texts");
      for (const Tree& item : tree.items) {
        lab_.given_occupancies.push_back(occupancy(item, list->first, word(item, list->first)));
      }
    }
    if (file == given_.end()) return;
    const Tree& tree = *file->second;
    const std::filesystem::path path = folder_ / word(tree, file->first);
    const std::string text = read_text(path, place(tree, file->first) + ": " + path.string());
    int line_number = 0;
    for (std::size_t begin = 0; begin < text.size();) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      const std::string_view line = std::string_view(text).substr(begin, end - begin);
      begin = end + 1;
      ++line_number;
      if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
      lab_.given_occupancies.push_back(
          occupancy(tree, fmt::format("{}:{}", path.string(), line_number), line));
    }
  }

  std::string file_;
  std::filesystem::path folder_;
  Lab lab_;
  std::map<std::string, const Tree*> given_;
  std::set<std::string> done_;
  bool grid_checked_ = false;
};

Lab parse(std::string_view text, std::string_view place, bool json, const std::filesystem::path& folder) {
  const Tree tree = json ? parse_json(text, place) : parse_toml(text, place);
  return Walker(place, folder).read(tree);
}

}  // namespace

Lab read_lab(const std::filesystem::path& file) {
  const std::string place = file.string();
  const std::string text = read_text(file, place);
  const std::string extension = file.extension().string();
  if (extension != ".toml" && extension != ".json") {
    throw Error(place, fmt::format("extension {}; allowed .toml, .json", in_quotes(extension)));
  }
  return parse(text, place, extension == ".json", file.parent_path());
}

Lab parse_lab(std::string_view text, std::string_view place, bool json) {
  return parse(text, place, json, {});
}

}  // namespace atomcam
