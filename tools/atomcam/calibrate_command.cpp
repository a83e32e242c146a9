// atomcam calibrate: a lab file from frames and notes.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "atomcam/command_text.hpp"
#include "atomcam/commands.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/step_progress.hpp"
#include "base/error.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/report_folder.hpp"
#include "calibration/stack_frames.hpp"
#include "data/output_files.hpp"

namespace atomcam {
namespace {

struct CalibrateOptions {
  std::string frames, darks, notes, output, report;
  std::string background;
  double background_exposure_s = 0;
  std::vector<std::string> flats;
  std::vector<double> flats_exposures;
  std::string model = "plain";
};

std::string figure(double value, double error) {
  if (!std::isfinite(value)) return "-";
  if (!(error > 0)) return fmt::format("{:.6g}", value);
  // As many digits as the error has, and one more.
  const int digits = static_cast<int>(std::floor(std::log10(error)));
  return fmt::format("{:.{}f}", value, std::clamp(1 - digits, 0, 9));
}

void print_flats(const PhotonTransfer& flats) {
  fmt::print("flats (EMVA 1288): variance over signal {} +- {:.2g} counts, chi square {:.0f} over {}\n",
             figure(flats.slope, flats.slope_error), flats.slope_error, flats.chi_square,
             flats.levels.size());
  fmt::print("{:>10}  {:>12}  {:>12}  {:>10}  {:>12}\n", "exposure", "signal", "variance", "error",
             "light noise");
  for (const FlatLevel& level : flats.levels)
    fmt::print("{:>10}  {:>12.2f}  {:>12.3f}  {:>10.2g}  {:>11.3f}%{}\n",
               level.exposure > 0 ? fmt::format("{:.4g}", level.exposure) : "-", level.signal_counts,
               level.variance_counts, level.variance_error, 100 * level.light_noise,
               level.saturated ? "  saturated" : "");
}

void print_table(const Calibration& calibration) {
  std::size_t widest = 9, units = 4;
  for (const CalibratedParameter& one : calibration.parameters) {
    widest = std::max(widest, one.key.size());
    units = std::max(units, one.unit.size());
  }
  fmt::print("{:<{}}  {:>12}  {:>14}  {:>10}  {:<{}}  {:>7}\n", "parameter", widest, "notes", "fit", "error",
             "unit", units, "pull");
  for (const CalibratedParameter& one : calibration.parameters) {
    const bool known = one.error > 0, pulls = known && std::isfinite(one.noted);
    fmt::print("{:<{}}  {:>12}  {:>14}  {:>10}  {:<{}}  {:>7}\n", one.key, widest, figure(one.noted, 0),
               figure(one.fitted, one.error),
               one.from_notes ? "by notes"
               : known        ? fmt::format("{:.2g}", one.error)
                              : "-",
               one.unit == "1" ? "" : one.unit, units, pulls ? fmt::format("{:+.1f}", one.pull()) : "");
  }
  const auto chi_square = [](const char* what, double value, int count) {
    if (count > 0) fmt::print("chi square of the {}: {:.0f} over {}\n", what, value, count);
  };
  chi_square("histogram of counts", calibration.counts.chi_square, calibration.counts.bins);
  if (calibration.has_sites) {
    chi_square("mean image", calibration.optics.chi_square, calibration.optics.degrees_of_freedom);
    chi_square("histogram of site brightness", calibration.atoms.chi_square, calibration.atoms.bins);
  }
  if (calibration.flats) print_flats(*calibration.flats);
  for (const std::string& warning : calibration.warnings) fmt::print("warning: {}\n", warning);
}

void run(const CalibrateOptions& options) {
  if (options.model != "plain" && options.model != "full")
    throw Error("--model", fmt::format("is '{}'; allowed: plain, full", options.model));
  if (!options.flats_exposures.empty() && options.flats_exposures.size() != options.flats.size())
    throw Error("--flats-exposure", fmt::format("has {} values for {} stacks of --flats",
                                                options.flats_exposures.size(), options.flats.size()));
  const Notes notes = read_notes(options.notes);
  const auto frames = open_frames(options.frames);
  const auto darks = options.darks.empty() ? nullptr : open_frames(options.darks);
  const auto background = options.background.empty() ? nullptr : open_frames(options.background);
  std::vector<std::unique_ptr<FrameSequence>> flats;
  for (const std::string& file : options.flats) flats.push_back(open_frames(file));
  if (!options.report.empty()) check_folder(options.report, "--report");
  CalibrationInput input;
  input.notes = notes;
  input.frames = frames.get();
  input.darks = darks.get();
  input.background = background.get();
  input.background_exposure_s = options.background_exposure_s;
  for (std::size_t n = 0; n < flats.size(); ++n)
    input.flats.push_back({flats[n].get(), options.flats_exposures.empty() ? 0 : options.flats_exposures[n]});
  input.full = options.model == "full";
  Calibration calibration;
  {
    StepProgress progress;
    input.progress = [&](std::string_view step, double done) { progress.update(step, done); };
    calibration = calibrate(input);
  }
  write_text(options.output, write_lab(calibration.lab));
  if (!options.report.empty()) {
    CommandText command("atomcam calibrate");
    command.add("--frames", options.frames);
    if (!options.darks.empty()) command.add("--darks", options.darks);
    if (!options.background.empty()) command.add("--background", options.background);
    for (const std::string& file : options.flats) command.add("--flats", file);
    if (options.model != "plain") command.add("--model", options.model);
    command.add("--lab", options.notes).add("-o", options.output).add("--report", options.report);
    make_folder(options.report, "--report");
    write_calibration(options.report, calibration, input, command.text());
  }
  for (const std::string& key : notes.not_understood)
    fmt::print(stderr, "{}: {}: not understood, left alone\n", options.notes, key);
  print_table(calibration);
}

}  // namespace

void add_calibrate_command(CLI::App& app) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = app.add_subcommand("calibrate", "A lab file whose simulation matches your frames");
  command->add_option("--frames", options->frames, "Stack of frames of the atoms")->required();
  command->add_option("--darks", options->darks, "Stack with the shutter closed, same settings");
  command->add_option("--background", options->background, "Stack without atoms, light on");
  command->add_option("--background-exposure", options->background_exposure_s,
                      "Its exposure in seconds, if not that of the frames");
  command->add_option("--flats", options->flats,
                      "Evenly lit stacks, one a level of light; they need --darks");
  command->add_option("--flats-exposure", options->flats_exposures, "Exposure of each, for the linearity");
  command->add_option("--lab", options->notes, "Notes on the set-up, TOML or JSON (docs/calibration.md)")
      ->required();
  command->add_option("-o,--output", options->output, "Lab file to write (TOML)")->required();
  command->add_option("--report", options->report, "Folder to write report.html and calibration.json into");
  command
      ->add_option("--model", options->model,
                   "plain; full: also serial clock-induced charge, each site's brightness, maps")
      ->capture_default_str();
  command->footer(
      "Example:\n"
      "  atomcam calibrate --frames frames.tif --darks darks.tif --lab notes.json -o lab.toml --report "
      "report");
  command->callback([options] { run_command("calibrate", [&] { run(*options); }); });
}

}  // namespace atomcam
