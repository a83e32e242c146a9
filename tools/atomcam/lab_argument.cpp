#include "atomcam/lab_argument.hpp"

#include "atomcam/set_option.hpp"
#include "simulation/workbench.hpp"

namespace atomcam {

Lab lab_of_argument(const std::string& argument, const std::vector<std::string>& settings) {
  Lab lab = load_lab(argument, "LAB");
  apply_settings(lab, settings);
  return lab;
}

}  // namespace atomcam
