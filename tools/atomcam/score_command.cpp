// atomcam score: how well does a detector find the atoms of a rendered stack?

#include <fmt/format.h>

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "atomcam/commands.hpp"
#include "atomcam/lab_argument.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/stack_settings.hpp"
#include "base/error.hpp"
#include "data/file.hpp"
#include "data/stack_reader.hpp"
#include "judging/detectors.hpp"
#include "judging/judgement_json.hpp"
#include "judging/scores_file.hpp"
#include "judging/stack_truth.hpp"

namespace atomcam {
namespace {

struct ScoreOptions {
  std::string stack;
  std::string result;
  std::string detector;
  std::string lab;
  std::string roc;
  std::string filled = "start";
  double threshold = 0.5;
  int half_width = 0;
  bool json = false;
};

std::string text_of(const Share& share) {
  if (share.number == 0) return fmt::format("{:>22}", "-");
  return fmt::format("{:>9.4f} % +- {:<8.2g}", 100 * share.value(), 100 * share.error);
}

void print_rows(const char* title, const std::vector<Confusion>& rows) {
  fmt::print("\n{:<32}  {:>8}  {:<22}  {:>8}  {:<22}\n", title, "filled", "  called filled", "empty",
             "  called filled");
  for (const Confusion& row : rows)
    if (row.found.number || row.false_alarms.number)
      fmt::print("{:<32}  {:>8}  {}  {:>8}  {}\n", row.of, row.found.number, text_of(row.found),
                 row.false_alarms.number, text_of(row.false_alarms));
}

void print(const ScoreOptions& options, const Judgement& judgement) {
  fmt::print("{}: {} frames of {} sites, {}\n", options.stack, judgement.frames, judgement.sites,
             options.result.empty() ? options.detector + " detector (taught by the other half of the frames)"
                                    : options.result);
  fmt::print("fidelity      {}  of {} sites called rightly, threshold {:g}\n", text_of(judgement.fidelity),
             judgement.fidelity.number, judgement.threshold);
  fmt::print("found         {}  of {} filled sites\n", text_of(judgement.found), judgement.found.number);
  fmt::print("false alarms  {}  of {} empty sites\n", text_of(judgement.false_alarms),
             judgement.false_alarms.number);
  fmt::print("ROC area      {:>9.6f}   +- {:.2g}\n", judgement.auc, judgement.auc_error);
  fmt::print("best          {:>9.4f} %  with the truth in hand, threshold {:g}\n",
             100 * judgement.best_fidelity, judgement.best_threshold);
  print_rows("brightness", judgement.by_brightness);
  print_rows("loss", judgement.by_loss);
  print_rows("neighbours", judgement.by_neighbours);
}

void write_roc(const std::string& file, const Judgement& judgement) {
  File out(file, "wb");
  out.write("threshold,false_alarms,found\n");
  for (const RocPoint& point : judgement.roc)
    out.write(fmt::format("{},{},{}\n", point.threshold, point.false_alarms, point.found));
  out.close();
}

void run(const ScoreOptions& options) {
  if (options.result.empty() == options.detector.empty())
    throw Error("--result, --detector", "one of them says what is judged");
  const auto stack = open_stack(options.stack);
  if (options.lab.empty() && stack->notes().lab.empty())
    throw Error("--lab", options.stack + " does not say which lab it shows");
  const Lab lab =
      options.lab.empty() ? parse_lab(stack->notes().lab, options.stack) : lab_of_argument(options.lab, {});
  const StackSettings settings = StackSettings::parse(stack->notes().settings, options.stack);
  auto truth =
      stack_truth(*stack, lab.scene.sites, options.filled == "start" ? FilledAt::start : FilledAt::end);
  SiteScores scores;
  double threshold = options.threshold;
  if (options.detector.empty()) {
    scores = read_scores(options.result, stack->frames(), lab.scene.sites.size());
  } else {
    Detected detected = detect(
        *stack, lab, {settings.offset_x, settings.offset_y, settings.binning_x, settings.binning_y},
        options.detector == "matched" ? Detector::matched : Detector::threshold, truth, options.half_width);
    scores = std::move(detected.scores);
    truth = std::move(detected.truth);
    threshold = detected.threshold;
  }
  const double exposure_s = settings.exposure_s > 0 ? settings.exposure_s : lab.settings.exposure_s;
  const Judgement judgement = judge(scores, truth, threshold, exposure_s);
  if (!options.roc.empty()) write_roc(options.roc, judgement);
  if (options.json)
    fmt::print("{}\n", judgement_json(judgement).dump(2));
  else
    print(options, judgement);
}

}  // namespace

void add_score_command(CLI::App& app) {
  auto options = std::make_shared<ScoreOptions>();
  CLI::App* command = app.add_subcommand(
      "score", "Judge a detector of atoms by the truth of rendered frames: fidelity, ROC, confusion");
  command->add_option("FRAMES", options->stack, "A file of `atomcam render` or `atomcam grab`")->required();
  command->add_option(
      "--result", options->result,
      "What the detector says, [frame, site]: occupancy or probability (.csv .json .npy .npz .h5)");
  command
      ->add_option(
          "--detector", options->detector,
          "Judge a built-in detector: threshold (sum of a square) or matched (point-spread function)")
      ->check(CLI::IsMember({"threshold", "matched"}));
  command
      ->add_option("--threshold", options->threshold, "A site whose value is not below it is called filled")
      ->capture_default_str();
  command
      ->add_option("--filled", options->filled,
                   "Filled is: when the exposure began (start), or still at its end (end)")
      ->check(CLI::IsMember({"start", "end"}))
      ->capture_default_str();
  command
      ->add_option("--half-width", options->half_width,
                   "Of a built-in detector's square, pixels (default: by the light in it)")
      ->check(CLI::Range(1, 32));
  command->add_option("--lab", options->lab, "The lab that the frames show (default: as the stack notes it)");
  command->add_option("--roc", options->roc, "Write the curve, threshold and both shares (.csv)");
  command->add_flag("--json", options->json, "Print JSON");
  command->footer(
      "Every share has one standard error, from the scatter between frames.\n\n"
      "Examples:\n"
      "  atomcam render ixon-ultra-897 -n 400 -o frames.h5\n"
      "  atomcam score frames.h5 --detector threshold\n"
      "  atomcam score frames.h5 --detector matched --roc matched.csv\n"
      "  atomcam score frames.h5 --result my_detector.npy --threshold 0.5 --json");
  command->callback([options] { run_command("score", [&] { run(*options); }); });
}

}  // namespace atomcam
