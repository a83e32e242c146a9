// atomcam render: frames of a lab into a file.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <deque>
#include <future>
#include <memory>
#include <optional>

#include "atomcam/commands.hpp"
#include "atomcam/interrupt.hpp"
#include "atomcam/lab_argument.hpp"
#include "atomcam/progress.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/set_option.hpp"
#include "atomcam/stack_settings.hpp"
#include "base/error.hpp"
#include "data/npy.hpp"
#include "data/stack.hpp"
#include "simulation/parallel.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

struct RenderOptions {
  std::string lab;
  std::string output;
  std::string expected;
  std::uint64_t frames = 1;
  std::uint64_t first = 0;
  int threads = 0;
  std::optional<std::uint64_t> seed;
  std::vector<std::string> settings;
};

struct Rendered {
  Frame frame;
  PhotonImage expected;
};

void run(const RenderOptions& options) {
  Lab lab = lab_of_argument(options.lab, options.settings);
  if (options.seed) set_parameter(lab, "seed", std::to_string(*options.seed), "--seed");
  const Simulation simulation(lab);
  const CameraSettings& camera = lab.settings;
  StackSettings notes = StackSettings::of(lab);
  notes.command = "render";
  notes.first_frame = options.first;

  const Shape shape{camera.output_height(), camera.output_width()};
  const auto writer =
      StackWriter::create(options.output, shape, {write_lab(lab), notes.to_json()}, options.frames);
  std::optional<NpyWriter> expected;
  if (!options.expected.empty()) expected.emplace(options.expected, shape, "<f4");

  catch_interrupts();
  at_run_time([&] {
    // Whole frames side by side; few frames share out their rows instead.
    const auto threads = static_cast<std::uint64_t>(thread_count(options.threads));
    const auto side_by_side = std::min(threads, std::max<std::uint64_t>(1, options.frames));
    const int threads_each = static_cast<int>(threads / side_by_side);
    const auto render = [&](std::uint64_t number) {
      Rendered rendered{simulation.render(number, camera, threads_each), {}};
      if (expected) rendered.expected = simulation.expected_electrons(number, camera);
      return rendered;
    };
    std::deque<std::future<Rendered>> under_way;
    Progress progress(options.frames);
    for (std::uint64_t begun = 0; writer->frames() < options.frames && !interrupted();) {
      for (; begun < options.frames && under_way.size() < side_by_side; ++begun)
        under_way.push_back(std::async(std::launch::async, render, options.first + begun));
      const Rendered rendered = under_way.front().get();
      under_way.pop_front();
      if (begun < options.frames)
        under_way.push_back(std::async(std::launch::async, render, options.first + begun++));
      if (expected) expected->append(std::as_bytes(rendered.expected.pixels()));
      writer->append(rendered.frame.counts, rendered.frame.truth.to_json());
      progress.update(writer->frames());
    }
    writer->finish();
    if (expected) expected->close();
    const double seconds = progress.seconds();
    fmt::print(stderr, "{}: {} frames of {} x {} pixels, {:.1f} frames/s{}\n", options.output,
               writer->frames(), shape.columns, shape.rows, static_cast<double>(writer->frames()) / seconds,
               interrupted() ? "; stopped, what is there is complete" : "");
  });
}

}  // namespace

void add_render_command(CLI::App& app) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* command =
      app.add_subcommand("render", "Render frames of a lab into a file, truth and settings beside them");
  command
      ->add_option("LAB", options->lab,
                   fmt::format("A lab file or a preset: {}", fmt::join(preset_names(), ", ")))
      ->required();
  command->add_option("-n,--frames", options->frames, "How many frames")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 40))
      ->capture_default_str();
  command
      ->add_option("-o,--output", options->output,
                   fmt::format("File to write; its extension chooses the format: {}",
                               fmt::join(stack_extensions(), " ")))
      ->required();
  command->add_option("--first", options->first, "Number of the first frame")->capture_default_str();
  command
      ->add_option("--threads", options->threads,
                   "Threads; the frames do not depend on it (default: all cores)")
      ->check(CLI::Range(1, 1024));
  command->add_option("--seed", options->seed, "Seed instead of the lab's");
  command->add_option(
      "--expected", options->expected,
      "Also write the expected electrons per pixel of every frame (.npy, 32-bit floating point)");
  add_set_option(*command, options->settings);
  command->footer(
      "Frame n of a lab is always the same, whoever renders it. Ctrl-C keeps the frames that are done.\n\n"
      "Examples:\n"
      "  atomcam render ixon-ultra-897 -n 100 -o frames.tif\n"
      "  atomcam render my_lab.toml -n 1000 --first 5000 -o part5.h5 --set atoms.filling=0.7\n"
      "  atomcam render orca-quest -n 10 -o frames.npy --expected means.npy");
  command->callback([options] { run_command("render", [&] { run(*options); }); });
}

}  // namespace atomcam
