// atomcam grab: frames of a camera on the network into a file, truth beside them if the camera tells it.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "atomcam/aravis_client.hpp"
#include "atomcam/commands.hpp"
#include "atomcam/interrupt.hpp"
#include "atomcam/lab_argument.hpp"
#include "atomcam/progress.hpp"
#include "atomcam/run_command.hpp"
#include "base/error.hpp"
#include "data/stack.hpp"

namespace atomcam {
namespace {

struct GrabOptions {
  bool list = false;
  std::string address;
  std::string output;
  std::string lab;
  std::uint64_t frames = 1;
  std::optional<double> exposure_us;
  double timeout_s = 10;
  std::vector<std::string> settings;
};

/// The camera's own number of a frame if its truth tells it, else the stream's.
std::uint64_t frame_number(const GrabbedFrame& frame) {
  const auto truth = nlohmann::json::parse(frame.truth, nullptr, false);
  const auto number = truth.is_object() ? truth.find("frame") : truth.end();
  return number != truth.end() && number->is_number_unsigned() ? number->get<std::uint64_t>() : frame.id;
}

void list() {
  const std::vector<FoundCamera> cameras = find_cameras();
  if (cameras.empty()) fmt::print("no camera answers\n");
  for (const FoundCamera& camera : cameras)
    fmt::print("{:<16} {:<10} {}\n", camera.address, camera.protocol, camera.id);
}

void run(const GrabOptions& options) {
  if (options.list) return list();
  if (options.address.empty()) throw Error("ADDRESS", "missing; an address such as 127.0.0.1, or --list");
  if (options.output.empty()) throw Error("--output", "missing; a file to write");
  StackNotes notes;
  if (!options.lab.empty()) notes.lab = write_lab(lab_of_argument(options.lab));
  AravisClient client(options.address);
  for (const std::string& setting : options.settings) {
    const auto equals = setting.find('=');
    if (equals == setting.npos || equals == 0)
      throw Error("--set", "'" + setting + "'; allowed Feature=value, such as Gain=100");
    client.set(setting.substr(0, equals), setting.substr(equals + 1));
  }
  if (options.exposure_us) client.set("ExposureTime", fmt::format("{}", *options.exposure_us));

  catch_interrupts();
  std::unique_ptr<StackWriter> writer;
  std::uint64_t with_truth = 0;
  at_run_time([&] {
    Progress progress(options.frames);
    double seconds = 0;
    std::size_t bytes = 0;
    const auto take = [&](const GrabbedFrame& frame) {
      if (!writer) {
        StackSettings settings = client.settings();
        settings.first_frame = frame_number(frame);
        notes.settings = settings.to_json();
        writer = StackWriter::create(options.output, frame.counts.shape(), notes, options.frames);
      }
      with_truth += frame.truth.empty() ? 0 : 1;
      bytes += frame.counts.pixels().size_bytes();
      writer->append(frame.counts, frame.truth);
      progress.update(writer->frames());
      seconds = progress.seconds();
      return writer->frames() < options.frames;
    };
    const StreamReport report = client.grab(options.timeout_s, take, interrupted);
    if (writer) writer->finish();
    const std::uint64_t frames = writer ? writer->frames() : 0;
    fmt::print(stderr,
               "{}: {} frames of {} ({} with truth) in {:.1f} s: {:.1f} frames/s, {:.1f} MB/s\n"
               "receiver: {} failed, {} underrun, {} skipped frames; {} missing packets, {} asked again, {} "
               "came again\n",
               options.output, frames, client.model(), with_truth, seconds,
               static_cast<double>(frames) / seconds, static_cast<double>(bytes) * 1e-6 / seconds,
               report.failed, report.underrun, report.skipped, report.missing_packets, report.resend_requests,
               report.resent_packets);
    if (frames == 0) throw Failure("stopped before a frame came");
  });
}

}  // namespace

void add_grab_command(CLI::App& app) {
  auto options = std::make_shared<GrabOptions>();
  CLI::App* command = app.add_subcommand(
      "grab", "Grab frames from any GenICam camera into a file, with the truth if it tells it");
  command->add_option("ADDRESS", options->address, "IP address, or the camera's id or name");
  command->add_flag("--list", options->list, "List the cameras that answer");
  command->add_option("-n,--frames", options->frames, "How many frames")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 40))
      ->capture_default_str();
  command->add_option(
      "-o,--output", options->output,
      fmt::format("File to write; its extension chooses the format: {}", fmt::join(stack_extensions(), " ")));
  command->add_option("--exposure-us", options->exposure_us, "Exposure time in microseconds");
  command->add_option("--set", options->settings, "Set a feature before: --set Gain=100 (may be repeated)")
      ->type_name("FEATURE=VALUE")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_option("--lab", options->lab, "Lab (file or preset) to note in the file");
  command->add_option("--timeout", options->timeout_s, "Give up after so many seconds without a frame")
      ->capture_default_str();
  command->footer(
      "Examples:\n"
      "  atomcam grab --list\n"
      "  atomcam grab 127.0.0.1 -n 100 -o ixon.h5 --exposure-us 20000 --set Gain=100\n"
      "  atomcam grab 127.0.0.2 -n 20 -o orca.tif --set Height=512 --set OffsetY=896");
  command->callback([options] { run_command("grab", [&] { run(*options); }); });
}

}  // namespace atomcam
