// atomcam lab: prints a lab in full, or checks a lab file.

#include <memory>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "atomcam/commands.hpp"
#include "atomcam/set_option.hpp"
#include "base/error.hpp"
#include "simulation/lab.hpp"

namespace atomcam {
namespace {

struct LabOptions {
  std::string file;
  std::string preset_name = preset_names().front();
  std::string checked;
  bool json = false;
  bool plain = false;
  std::vector<std::string> settings;
};

std::string summary(const Lab& lab) {
  std::vector<std::string> effects;
  for (const auto& [name, values] : lab.effects) {
    if (!values.empty() && values[0] != 0) effects.push_back(name);
  }
  const std::string model = std::visit([](const auto& sensor) { return sensor.model; }, lab.sensor);
  return fmt::format("{}, {} sites, {} x {} pixels, effects: {}", model, lab.scene.sites.size(),
                     lab.settings.output_width(), lab.settings.output_height(),
                     effects.empty() ? "none" : fmt::format("{}", fmt::join(effects, ", ")));
}

void run(const LabOptions& options) {
  if (!options.checked.empty()) {
    Lab lab = read_lab(options.checked);
    apply_settings(lab, options.settings);
    fmt::print("{}: good ({})\n", options.checked, summary(lab));
    return;
  }
  Lab lab = options.file.empty() ? preset(options.preset_name) : read_lab(options.file);
  apply_settings(lab, options.settings);
  fmt::print("{}", options.json ? write_lab_json(lab) : write_lab(lab, !options.plain));
}

}  // namespace

void add_lab_command(CLI::App& app) {
  auto options = std::make_shared<LabOptions>();
  CLI::App* command =
      app.add_subcommand("lab", "Print a lab in full, every key with its comment, or check a lab file");
  auto* file = command->add_option("LAB", options->file, "Lab file to print in full (.toml, .json)");
  auto* preset_option = command
                            ->add_option("--preset", options->preset_name,
                                         fmt::format("Preset to print: {}", fmt::join(preset_names(), ", ")))
                            ->capture_default_str();
  auto* check =
      command->add_option("--check", options->checked, "Check this lab file and print nothing of it")
          ->type_name("FILE");
  auto* json = command->add_flag("--json", options->json, "Print JSON");
  command->add_flag("--plain", options->plain, "Print no comments")->excludes(json);
  add_set_option(*command, options->settings);
  file->excludes(preset_option)->excludes(check);
  check->excludes(preset_option);
  command->callback([options] {
    try {
      run(*options);
    } catch (const Error& error) {
      fmt::print(stderr, "atomcam lab: {}\n", error.what());
      throw CLI::RuntimeError(2);
    }
  });
}

}  // namespace atomcam
