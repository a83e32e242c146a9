#pragma once
// The subcommands of `atomcam`, one file each. Bad input is one line on stderr and exit code 2; what fails
// while the command runs, exit code 1. `diagnose` tells its verdict by 0 to 2: its errors are 3 and 4.

#include <CLI/CLI.hpp>

namespace atomcam {

void add_serve_command(CLI::App& app);
void add_render_command(CLI::App& app);
void add_grab_command(CLI::App& app);
void add_check_truth_command(CLI::App& app);
void add_score_command(CLI::App& app);
void add_lab_command(CLI::App& app);
void add_effects_command(CLI::App& app);
void add_blind_command(CLI::App& app);
void add_calibrate_command(CLI::App& app);
void add_diagnose_command(CLI::App& app);

}  // namespace atomcam
