// atomcam: virtual cameras for neutral-atom laboratories, on the command line.

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "atomcam/commands.hpp"
#include "base/error.hpp"

int main(int argc, char** argv) {
  CLI::App app(
      "Virtual cameras for neutral-atom laboratories: simulated frames of atom arrays with their truth.",
      "atomcam");
  app.set_version_flag("--version", "atomcam " ATOMCAM_VERSION);
  app.require_subcommand(1);
  app.footer("`atomcam COMMAND --help` explains a command.");
  atomcam::add_serve_command(app);
  atomcam::add_render_command(app);
  atomcam::add_grab_command(app);
  atomcam::add_check_truth_command(app);
  atomcam::add_score_command(app);
  atomcam::add_lab_command(app);
  atomcam::add_effects_command(app);
  atomcam::add_calibrate_command(app);
  atomcam::add_diagnose_command(app);
  atomcam::add_blind_command(app);
  const int bad_input = argc > 1 && std::string_view(argv[1]) == "diagnose" ? 3 : 2;
  try {
    std::vector<std::string> commands;
    for (const CLI::App* command : app.get_subcommands({})) commands.push_back(command->get_name());
    if (argc > 1 && argv[1][0] != '-' && std::ranges::find(commands, argv[1]) == commands.end())
      atomcam::throw_unknown("COMMAND", "command", argv[1], commands);
    app.parse(argc, argv);
  } catch (const atomcam::Error& error) {
    fmt::print(stderr, "atomcam: {}\n", error.what());
    return bad_input;
  } catch (const CLI::RuntimeError& failure) {
    return failure.get_exit_code();
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::string problem = error.what();
    std::ranges::replace(problem, '\n', ' ');
    fmt::print(stderr, "atomcam: {} (try --help)\n", problem);
    return bad_input;
  }
  return 0;
}
