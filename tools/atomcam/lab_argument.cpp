#include "atomcam/lab_argument.hpp"

#include <algorithm>
#include <filesystem>

#include "atomcam/set_option.hpp"
#include "base/error.hpp"

namespace atomcam {

Lab lab_of_argument(const std::string& argument, const std::vector<std::string>& settings) {
  const std::vector<std::string> presets = preset_names();
  Lab lab;
  if (std::ranges::find(presets, argument) != presets.end()) {
    lab = preset(argument);
  } else if (argument.find_first_of("./") == std::string::npos && !std::filesystem::exists(argument)) {
    throw_unknown("LAB", "preset (and no such file)", argument, presets);
  } else {
    lab = read_lab(argument);
  }
  apply_settings(lab, settings);
  return lab;
}

}  // namespace atomcam
