#include "atomcam/set_option.hpp"

#include "base/error.hpp"

namespace atomcam {

void apply_settings(Lab& lab, const std::vector<std::string>& settings) {
  for (const std::string& setting : settings) {
    const auto equals = setting.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw Error("--set", "'" + setting + "'; allowed key=value, such as atoms.filling=0.7");
    }
    set_parameter(lab, setting.substr(0, equals), setting.substr(equals + 1));
  }
  if (!settings.empty()) check_lab(lab, "--set");
}

}  // namespace atomcam
