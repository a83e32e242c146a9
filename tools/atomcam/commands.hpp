#pragma once
// The subcommands of `atomcam`, one file each. Bad input is one line on stderr and exit code 2.

#include <CLI/CLI.hpp>

namespace atomcam {

void add_lab_command(CLI::App& app);
void add_effects_command(CLI::App& app);

}  // namespace atomcam
