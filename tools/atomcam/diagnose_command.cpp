// atomcam diagnose: where frames differ from their simulation, and why.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "atomcam/cache_option.hpp"
#include "atomcam/command_text.hpp"
#include "atomcam/commands.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/step_progress.hpp"
#include "base/error.hpp"
#include "calibration/stack_frames.hpp"
#include "data/file_hash.hpp"
#include "data/output_files.hpp"
#include "diagnosis/against.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/diagnosis_json.hpp"
#include "diagnosis/report_folder.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr int bad_input = 3, failed = 4;
constexpr double for_diagnosis = 0.96;  // of the time; the rest is for the report

struct DiagnoseOptions {
  std::string frames, darks, notes, output, against;
  std::string background;
  double background_exposure_s = 0;
  std::vector<std::string> flats;
  std::vector<double> flats_exposures;
  std::vector<std::string> exclude, include;
  std::uint64_t seed = 1;
  int threads = 0;
  bool where_only = false, all_frames = false;
  CacheOption cache;
};

std::string command_of(const DiagnoseOptions& options) {
  CommandText text("atomcam diagnose");
  text.add("--frames", options.frames);
  if (!options.darks.empty()) text.add("--darks", options.darks);
  if (!options.background.empty()) text.add("--background", options.background);
  if (options.background_exposure_s > 0)
    text.add("--background-exposure", fmt::format("{}", options.background_exposure_s));
  for (const std::string& file : options.flats) text.add("--flats", file);
  for (const double exposure : options.flats_exposures)
    text.add("--flats-exposure", fmt::format("{}", exposure));
  if (!options.against.empty()) text.add("--against", options.against);
  text.add("--lab", options.notes).add("--out", options.output);
  for (const std::string& name : options.exclude) text.add("--exclude", name);
  for (const std::string& name : options.include) text.add("--include", name);
  if (options.where_only) text.add("--where-only");
  if (options.all_frames) text.add("--all-frames");
  return text.add("--seed", std::to_string(options.seed)).text();
}

int exit_code(Verdict verdict) {
  return verdict == Verdict::no_gap ? 0 : verdict == Verdict::explained ? 1 : 2;
}

void print_summary(const Diagnosis& diagnosis) {
  fmt::print("{}\n", diagnosis.sentence);
  if (diagnosis.against)
    fmt::print("gap {:.1f}, floor {:.1f}\n", diagnosis.gap.before, diagnosis.gap.floor);
  else if (diagnosis.verdict != Verdict::no_gap)
    fmt::print("gap {:.1f}, with what was found {:.1f}, floor {:.1f}\n", diagnosis.gap.before,
               diagnosis.gap.after, diagnosis.gap.floor);
  for (const FoundEffect& effect : diagnosis.effects)
    for (const FoundParameter& p : effect.parameters)
      fmt::print("  {}.{} = {:.4g} +- {:.2g}{}{}\n", effect.name, p.name, p.value, p.error(),
                 p.unit == "1" ? "" : " ", p.unit == "1" ? "" : p.unit);
  for (const char* stack : {"frames", "darks", "against"})
    if (const FrameChoice choice = diagnosis.looked_at(stack); !choice.is_all())
      fmt::print("looked at {} of {} frames of --{} (--all-frames: at all)\n", choice.count(), choice.all(),
                 stack);
  for (const std::string& one : diagnosis.calibration.warnings) fmt::print("warning: {}\n", one);
  for (const std::string& one : diagnosis.next_measurement) fmt::print("next: {}\n", one);
}

int run(const DiagnoseOptions& options) {
  if (!options.against.empty() && !(options.include.empty() && options.exclude.empty()))
    throw Error("--against",
                "compares two stacks without any effects: --include and --exclude are not allowed");
  if (!options.flats_exposures.empty() && options.flats_exposures.size() != options.flats.size())
    throw Error("--flats-exposure", fmt::format("has {} values for {} stacks of --flats",
                                                options.flats_exposures.size(), options.flats.size()));
  const Notes notes = read_notes(options.notes);
  const auto frames = open_frames(options.frames);
  const auto darks = options.darks.empty() ? nullptr : open_frames(options.darks);
  const auto against = options.against.empty() ? nullptr : open_frames(options.against);
  const auto background = options.background.empty() ? nullptr : open_frames(options.background);
  std::vector<std::unique_ptr<FrameSequence>> flats;
  for (const std::string& file : options.flats) flats.push_back(open_frames(file));
  const std::filesystem::path folder = options.output;
  check_folder(folder, "--out");

  DiagnosisInputs inputs;
  const auto add_stack = [&](const char* role, const std::string& file, const FrameSequence& stack) {
    inputs.files.push_back({role, file, sha256_of(file), stack.frames(), stack.shape()});
  };
  add_stack("frames", options.frames, *frames);
  if (darks) add_stack("darks", options.darks, *darks);
  if (background) add_stack("background", options.background, *background);
  for (std::size_t n = 0; n < flats.size(); ++n)
    add_stack(fmt::format("flats_{}", n + 1).c_str(), options.flats[n], *flats[n]);
  if (against) add_stack("against", options.against, *against);
  inputs.files.push_back({"notes", options.notes, sha256_of(options.notes), 0, {}});
  inputs.exclude = options.exclude;
  inputs.include = options.include;
  inputs.seed = options.seed;
  inputs.version = ATOMCAM_VERSION;
  inputs.command = command_of(options);

  DiagnosisOptions how;
  how.exclude = options.exclude;
  how.include = options.include;
  how.beside.background = background.get();
  how.beside.background_exposure_s = options.background_exposure_s;
  for (std::size_t n = 0; n < flats.size(); ++n)
    how.beside.flats.push_back(
        {flats[n].get(), options.flats_exposures.empty() ? 0 : options.flats_exposures[n]});
  how.seed = options.seed;
  how.where_only = options.where_only;
  how.all_frames = options.all_frames;
  how.threads = thread_count(options.threads);
  how.cache = options.cache.path();
  Diagnosis diagnosis;
  {
    StepProgress progress;
    how.progress = [&](std::string_view step, double done) { progress.update(step, done * for_diagnosis); };
    diagnosis = against ? diagnose_against(notes, *frames, *against, darks.get(), how)
                        : diagnose(notes, *frames, darks.get(), how);
    write_diagnosis(
        folder, diagnosis, inputs, *frames, darks.get(), against.get(), how.threads, how.cache,
        [&](double done) { progress.update("report", for_diagnosis + (1 - for_diagnosis) * done); });
  }
  for (const std::string& key : notes.not_understood)
    fmt::print(stderr, "{}: {}: not understood, left alone\n", options.notes, key);
  print_summary(diagnosis);
  return exit_code(diagnosis.verdict);
}

}  // namespace

void add_diagnose_command(CLI::App& app) {
  auto options = std::make_shared<DiagnoseOptions>();
  CLI::App* command = app.add_subcommand(
      "diagnose", "Where your frames differ from their simulation, and which effect it is");
  command->add_option("--frames", options->frames, "Stack of frames of the atoms")->required();
  command->add_option("--darks", options->darks, "Stack with the shutter closed, same settings");
  command->add_option("--lab", options->notes, "Notes on the set-up, TOML or JSON (docs/calibration.md)")
      ->required();
  command
      ->add_option("--out", options->output, "Folder to write diagnosis.json, lab.toml and report.html into")
      ->required();
  command->add_option("--background", options->background, "Stack without atoms, light on");
  command->add_option("--background-exposure", options->background_exposure_s,
                      "Its exposure in seconds, if not that of the frames");
  command->add_option("--flats", options->flats,
                      "Evenly lit stacks, one a level of light; they need --darks");
  command->add_option("--flats-exposure", options->flats_exposures, "Exposure of each, for the linearity");
  command->add_option("--against", options->against,
                      "Another stack, to compare the frames with instead of their simulation");
  command->add_option("--exclude", options->exclude, "An effect that is not looked for (may be repeated)")
      ->allow_extra_args(false);
  command
      ->add_option("--include", options->include,
                   "Look for this effect and no others but those included too (may be repeated)")
      ->allow_extra_args(false);
  command->add_flag("--where-only", options->where_only, "Say where the gap lies, look for no effects");
  command->add_flag(
      "--all-frames", options->all_frames,
      "Look at every frame, also of a long stack of large ones (default: at 64 or more that have 17 "
      "million pixels, in stretches over the whole stack); takes longer by as much");
  command->add_option("--seed", options->seed, "Seed of the simulations")->capture_default_str();
  command
      ->add_option("--threads", options->threads,
                   "Threads; the result does not depend on it (default: all cores)")
      ->check(CLI::Range(1, 1024));
  options->cache.add_to(*command);
  command->footer(
      "Exit code: 0 no gap, 1 gap explained, 2 partly explained, unexplained or ambiguous, 3 bad input, 4 "
      "something failed.\n\n"
      "Example:\n"
      "  atomcam diagnose --frames frames.tif --darks darks.tif --lab notes.json --out diagnosis");
  command->callback([options] {
    int code = 0;
    run_command(
        "diagnose", [&] { code = run(*options); }, bad_input, failed);
    if (code != 0) throw CLI::RuntimeError(code);
  });
}

}  // namespace atomcam
