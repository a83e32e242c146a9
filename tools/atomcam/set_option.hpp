#pragma once
// --set key=value, the same for every subcommand that has a lab.

#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "simulation/lab.hpp"

namespace atomcam {

/// Adds --set; `settings` must outlive the parsing.
inline CLI::Option* add_set_option(CLI::App& command, std::vector<std::string>& settings) {
  return command
      .add_option("--set", settings, "Change one key of the lab: --set atoms.filling=0.7 (may be repeated)")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

/// In the order given, then the lab as a whole is checked. Throws Error.
void apply_settings(Lab& lab, const std::vector<std::string>& settings);

}  // namespace atomcam
