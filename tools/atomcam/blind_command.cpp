// atomcam blind: stacks with sealed effects, and how well a diagnosis names them.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "atomcam/cache_option.hpp"
#include "atomcam/commands.hpp"
#include "atomcam/interrupt.hpp"
#include "atomcam/progress.hpp"
#include "atomcam/run_command.hpp"
#include "base/error.hpp"
#include "calibration/stack_frames.hpp"
#include "data/output_files.hpp"
#include "data/stack.hpp"
#include "diagnosis/blind.hpp"
#include "diagnosis/blind_score.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/diagnosis_json.hpp"
#include "simulation/parallel.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

using Json = nlohmann::json;
using Path = std::filesystem::path;

struct MakeOptions {
  std::string output;
  int count = 10;
  BlindOptions blind;
};
struct ScoreOptions {
  std::string folder, table;
  std::vector<std::string> exclude;
  bool exclude_truth = false;
  int threads = 0;
  CacheOption cache;
};

std::string stack_name(int number) {
  return fmt::format("{:04}", number);
}

Json read_json(const Path& file) {
  std::ifstream in(file);
  if (!in) throw Error(file.string(), "cannot be read");
  try {
    return Json::parse(in);
  } catch (const Json::parse_error& error) {
    throw Error(file.string(), fmt::format("is not JSON: {}", error.what()));
  }
}

void write_stack(const Path& file, const Lab& lab, std::uint64_t first, std::uint64_t frames,
                 bool shutter_open) {
  const Simulation simulation(lab);
  CameraSettings settings = simulation.lab().settings;
  settings.shutter_open = shutter_open;
  const auto writer =
      StackWriter::create(file, {settings.output_height(), settings.output_width()}, {}, frames);
  for (std::uint64_t n = 0; n < frames; ++n)
    writer->append(simulation.render(first + n, settings).counts, "");
  writer->finish();
}

void make(MakeOptions options) {
  options.blind.threads = thread_count(options.blind.threads);
  for (const std::string& name : options.blind.effects)
    if (!find_effect(name)) throw Error("--effect", fmt::format("{} is not in the catalogue", name));
  const Path folder = options.output;
  make_folder(folder / "seals", "--out");
  catch_interrupts();
  at_run_time([&] {
    Progress progress(static_cast<std::uint64_t>(options.count), "stacks");
    for (int n = 0; n < options.count && !interrupted(); ++n) {
      const Path own = folder / stack_name(n);
      // The notes come last: a folder that has them is complete.
      if (!std::filesystem::exists(own / "lab.json")) {
        make_folder(own, "--out");
        const BlindStack stack = make_blind_stack(options.blind, static_cast<std::uint64_t>(n));
        write_stack(own / "frames.tif", stack.lab, 0, options.blind.frames, true);
        write_stack(own / "darks.tif", stack.lab, 1000000, options.blind.darks, false);
        Json seal;
        seal["effects"] = Json::array();
        for (const BlindEffect& effect : stack.effects) {
          Json& sealed = seal["effects"].emplace_back();
          sealed = {{"name", effect.name}, {"stage", effect.stage}, {"strength", effect.strength}};
          if (effect.detection_strength > 0) {
            sealed["detection_strength"] = effect.detection_strength;
            sealed["matched_filter"] = effect.matched_filter;
          }
        }
        seal["lab"] = write_lab(stack.lab);
        write_text(folder / "seals" / (stack_name(n) + ".json"), seal.dump(1));
        write_text(own / "lab.json", stack.notes);
      }
      progress.update(static_cast<std::uint64_t>(n) + 1);
    }
  });
}

BlindResult result_of(const Json& seal, const Path& file) {
  const Json found = read_json(file);
  BlindResult result;
  for (const Json& effect : seal["effects"])
    result.sealed.push_back({effect["name"], effect["stage"], effect.value("strength", 0.0),
                             effect.value("detection_strength", 0.0), effect.value("matched_filter", 0.0)});
  result.verdict = found["verdict"];
  for (const Json& effect : found["effects"]) {
    BlindResult::Found one{effect["name"], effect["stage"]};
    const Json& strength = effect["parameters"][find_effect(one.name)->parameters.front().key];
    if (!strength.contains("interval"))
      throw Error(file.string(),
                  "is of an older version, without intervals: remove it to have the stack judged again");
    one.low = strength["interval"][0];
    one.high = strength["interval"][1];
    result.found.push_back(std::move(one));
  }
  if (found["unexplained"]["stage"].is_string()) result.unexplained_stage = found["unexplained"]["stage"];
  result.p_gap = found["gap"]["p_before"];
  if (found["gap"]["closed"].is_number()) result.closed = found["gap"]["closed"];
  return result;
}

void score(const ScoreOptions& options) {
  const Path folder = options.folder;
  std::vector<std::string> stacks;
  if (!std::filesystem::is_directory(folder / "seals"))
    throw Error(options.folder, "has no folder seals: `atomcam blind make` writes it");
  for (const auto& entry : std::filesystem::directory_iterator(folder / "seals"))
    if (std::filesystem::exists(folder / entry.path().stem() / "lab.json"))
      stacks.push_back(entry.path().stem());
  std::sort(stacks.begin(), stacks.end());
  if (stacks.empty()) throw Error(options.folder, "has no complete stack");
  const std::string kind = options.exclude_truth     ? "withheld"
                           : options.exclude.empty() ? "diagnosis"
                                                     : "excluded";
  catch_interrupts();
  at_run_time([&] {
    Progress progress(stacks.size(), "stacks");
    BlindScore tables;
    std::uint64_t done = 0;
    for (const std::string& name : stacks) {
      if (interrupted()) break;
      const Json seal = read_json(folder / "seals" / (name + ".json"));
      const Path result = folder / name / (kind + ".json");
      if (!std::filesystem::exists(result)) {
        DiagnosisOptions how;
        how.exclude = options.exclude;
        if (options.exclude_truth)
          for (const Json& effect : seal["effects"])
            if (find_effect(std::string(effect["name"]))) how.exclude.push_back(effect["name"]);
        how.threads = thread_count(options.threads);
        how.cache = options.cache.path();
        const auto frames = open_frames(folder / name / "frames.tif"),
                   darks = open_frames(folder / name / "darks.tif");
        try {
          const Diagnosis diagnosis =
              diagnose(read_notes(folder / name / "lab.json"), *frames, darks.get(), how);
          DiagnosisInputs inputs;
          inputs.exclude = how.exclude;
          write_text(result, diagnosis_json(diagnosis, inputs));
        } catch (const Error& error) {
          fmt::print(stderr, "stack {} is refused: {}\n", name, error.what());
          tables.add_refused();
          progress.update(++done);
          continue;
        }
      }
      tables.add(result_of(seal, result));
      progress.update(++done);
    }
    const std::string table = tables.tables();
    fmt::print("{}", table);
    if (!options.table.empty()) write_text(options.table, table);
  });
}

}  // namespace

void add_blind_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("blind", "Blind checks of the diagnosis: stacks with sealed effects");
  command->require_subcommand(1);
  auto to_make = std::make_shared<MakeOptions>();
  to_make->blind.threads = 0;
  to_make->blind.any_lab = true;
  CLI::App* making = command->add_subcommand("make", "Write stacks with random sealed effects");
  making
      ->add_option("-o,--out", to_make->output,
                   "Folder: NNNN/{frames.tif,darks.tif,lab.json}, seals/NNNN.json")
      ->required();
  making->add_option("-n,--stacks", to_make->count, "How many")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  making->add_option("--frames", to_make->blind.frames, "Frames of a stack")
      ->check(CLI::Range(40, 100000))
      ->capture_default_str();
  making->add_option("--darks", to_make->blind.darks, "Dark frames of a stack")
      ->check(CLI::Range(4, 100000))
      ->capture_default_str();
  making->add_option("--seed", to_make->blind.seed, "Seed of the series")->capture_default_str();
  making->add_option("--rows", to_make->blind.rows, "Rows of a frame")
      ->check(CLI::Range(48, 2048))
      ->capture_default_str();
  making->add_option("--columns", to_make->blind.columns, "Columns of a frame")
      ->check(CLI::Range(48, 2048))
      ->capture_default_str();
  making
      ->add_option("--effect", to_make->blind.effects,
                   "Choose among these effects (may be repeated; default: all)")
      ->allow_extra_args(false);
  making->add_option("--none", to_make->blind.none_share, "Share of stacks without an effect")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  making->add_option("--pairs", to_make->blind.pair_share, "Share of stacks with two")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  making->add_option("--weakest", to_make->blind.weakest, "Least strength, in the unit below")
      ->check(CLI::Range(1e-3, 1e3))
      ->capture_default_str();
  making->add_option("--strongest", to_make->blind.strongest, "Largest strength, in the unit below")
      ->check(CLI::Range(1e-3, 1e3))
      ->capture_default_str();
  making->add_flag(
      "--of-detection", to_make->blind.of_detection,
      "Unit of strength: that at which 9 of 10 stacks show a gap (measured for each stack's lab, "
      "some seconds to minutes), not the effect's default");
  making->add_flag(
      "--usual-lab{false}", to_make->blind.any_lab,
      "Set-points of one lab per camera (exposure 80 ms, EM gain 300, ...), not of all kinds of labs");
  making->add_option("--threads", to_make->blind.threads, "Threads (default: all cores)")
      ->check(CLI::Range(1, 1024));
  making->footer(
      "What is there already is kept: run it again to go on.\n\nExample:\n  atomcam blind make -n 50 -o "
      "blind");
  making->callback([to_make] { run_command("blind make", [&] { make(*to_make); }); });

  auto to_score = std::make_shared<ScoreOptions>();
  CLI::App* scoring =
      command->add_subcommand("score", "Diagnose the stacks, open the seals, print the table");
  scoring->add_option("DIR", to_score->folder, "Folder that `blind make` wrote")->required();
  scoring->add_option("--exclude", to_score->exclude, "An effect that is not looked for (may be repeated)")
      ->allow_extra_args(false);
  scoring->add_flag("--withhold", to_score->exclude_truth,
                    "Exclude the sealed effects of each stack: the right verdict is \"unexplained\"");
  scoring->add_option("--table", to_score->table, "Also write the table into this file (Markdown)");
  scoring->add_option("--threads", to_score->threads, "Threads (default: all cores)")
      ->check(CLI::Range(1, 1024));
  to_score->cache.add_to(*scoring);
  scoring->footer(
      "Diagnoses that are there already are kept: Ctrl-C and go on later.\n\nExample:\n  atomcam blind score "
      "blind --table validation.md");
  scoring->callback([to_score] { run_command("blind score", [&] { score(*to_score); }); });
}

}  // namespace atomcam
