// atomcam serve: labs as cameras on the network.

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <thread>

#include "atomcam/commands.hpp"
#include "atomcam/interrupt.hpp"
#include "atomcam/lab_argument.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/set_option.hpp"
#include "base/error.hpp"
#include "simulation/parallel.hpp"
#include "virtual_camera/virtual_camera.hpp"

namespace atomcam {
namespace {

using Clock = std::chrono::steady_clock;

struct ServeOptions {
  std::vector<std::string> labs;
  std::vector<std::string> addresses;
  std::vector<std::string> settings;
  VirtualCameraOptions camera;
  double duration_s = 0;
  bool quiet = false;
};

/// The k-th camera's address: 127.0.0.1, 127.0.0.2, ...
std::string default_address(std::size_t k) {
  return fmt::format("127.0.{}.{}", (k + 1) / 256, (k + 1) % 256);
}

/// One camera's line of the status, from what it sent since the last one.
class Status {
 public:
  explicit Status(VirtualCamera& camera) : camera_(camera) {}
  std::string line() {
    const auto now = Clock::now();
    const gige::Device::Statistics statistics = camera_.device().statistics();
    const gige::StreamStatistics& stream = statistics.stream;
    const double seconds = std::chrono::duration<double>(now - time_).count();
    const double rate = static_cast<double>(stream.frames - frames_) / seconds;
    const double megabytes = static_cast<double>(stream.bytes - bytes_) * 1e-6 / seconds;
    time_ = now;
    frames_ = stream.frames;
    bytes_ = stream.bytes;
    const std::string client =
        statistics.client
            ? fmt::format("{}:{}", gige::to_text(statistics.client->address), statistics.client->port)
            : "no client";
    return fmt::format("{} {}  {:<21} {:7.1f} frames/s {:8.1f} MB/s  packets lost {}, resent {}",
                       camera_.device().address(), camera_.camera().identity().model, client, rate, megabytes,
                       stream.faulted_packets, stream.resent);
  }
  bool idle() const { return !camera_.device().statistics().client; }

 private:
  VirtualCamera& camera_;
  Clock::time_point time_ = Clock::now();
  std::uint64_t frames_ = 0, bytes_ = 0;
};

void serve(std::vector<std::unique_ptr<VirtualCamera>>& cameras, const ServeOptions& options) {
  std::vector<Status> status;
  for (const auto& camera : cameras) status.emplace_back(*camera);
  const bool terminal = isatty(STDOUT_FILENO) == 1;
  // On a terminal the lines are drawn over each other every second; else one block every ten seconds in use.
  const auto start = Clock::now();
  auto shown = start;
  bool drawn = false;
  const auto pause = terminal ? std::chrono::seconds(1) : std::chrono::seconds(10);
  while (!interrupted()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    const auto now = Clock::now();
    if (options.duration_s > 0 && now - start > std::chrono::duration<double>(options.duration_s)) break;
    if (options.quiet || now - shown < pause) continue;
    shown = now;
    const bool all_idle = std::ranges::all_of(status, &Status::idle);
    if (terminal && drawn) fmt::print("\x1b[{}A", status.size());
    for (Status& one : status) {
      const std::string line = one.line();
      if (terminal || !all_idle) fmt::print("{}{}\n", line, terminal ? "\x1b[K" : "");
    }
    std::fflush(stdout);
    drawn = true;
  }
}

void run(const ServeOptions& options) {
  std::vector<std::string> names = options.labs;
  if (names.empty()) names = preset_names();
  if (options.addresses.size() > names.size())
    throw Error("--address", fmt::format("{} addresses for {} cameras; allowed one each",
                                         options.addresses.size(), names.size()));
  if (!options.camera.device.xml_file.empty() && !std::filesystem::exists(options.camera.device.xml_file))
    throw Error(options.camera.device.xml_file, "no such file");
  catch_interrupts();
  std::vector<std::unique_ptr<VirtualCamera>> cameras;
  for (std::size_t k = 0; k < names.size(); ++k) {
    Lab lab = lab_of_argument(names[k], options.settings);
    VirtualCameraOptions camera = options.camera;
    camera.device.address = k < options.addresses.size() ? options.addresses[k] : default_address(k);
    cameras.push_back(std::make_unique<VirtualCamera>(std::move(lab), camera));
    const auto identity = cameras.back()->camera().identity();
    fmt::print("{}  {} {}, serial {} ({})\n", cameras.back()->device().address(), identity.vendor,
               identity.model, identity.serial, names[k]);
  }
  fmt::print("serving; Ctrl-C ends it\n");
  std::fflush(stdout);
  at_run_time([&] { serve(cameras, options); });
}

CLI::Option* add_probability(CLI::App& command, const std::string& name, double& value,
                             const std::string& meaning) {
  return command.add_option(name, value, meaning)
      ->check(CLI::Range(0.0, 1.0))
      ->group("Faults, to test clients");
}

}  // namespace

void add_serve_command(CLI::App& app) {
  auto options = std::make_shared<ServeOptions>();
  options->camera.render_threads = thread_count();
  gige::DeviceOptions& device = options->camera.device;
  gige::FaultConfiguration& faults = device.faults;
  CLI::App* command =
      app.add_subcommand("serve", "Serve labs as cameras that GigE Vision clients find and grab from");
  command->add_option(
      "LAB", options->labs,
      fmt::format("Lab files or presets, a camera each (default: {})", fmt::join(preset_names(), " ")));
  command
      ->add_option("--address", options->addresses,
                   "Address of a camera, in the order of the labs (default: 127.0.0.1, 127.0.0.2, ...)")
      ->type_name("IP")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  add_set_option(*command, options->settings);
  command->add_option("--threads", options->camera.render_threads, "Frames rendered at a time, per camera")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  command
      ->add_option(
          "--replay", options->camera.replay_frames,
          "Render so many frames once and show them again and again (for rates beyond live rendering)")
      ->check(CLI::Range(1, 100000));
  command->add_option("--packet-bytes", device.packet_bytes, "Size of stream packets until a client sets it")
      ->check(CLI::Range(220u, 65532u))
      ->capture_default_str();
  command->add_option("--xml", device.xml_file, "Serve this GenICam description instead of the camera's own");
  command->add_option("--duration", options->duration_s, "End after so many seconds");
  command->add_flag("--quiet", options->quiet, "No status lines");
  add_probability(*command, "--loss", faults.packet_loss, "Probability that a packet is lost");
  command->add_option("--loss-burst", faults.burst, "Packets lost in a row each time")
      ->check(CLI::Range(1u, 100000u))
      ->group("Faults, to test clients");
  add_probability(*command, "--reorder", faults.reorder,
                  "Probability that a packet changes places with the next");
  add_probability(*command, "--duplicate", faults.duplicate, "Probability that a packet is sent twice");
  add_probability(*command, "--frame-drop", faults.frame_drop, "Probability that a frame is not sent at all");
  add_probability(*command, "--frame-delay", faults.frame_delay, "Probability that a frame is held back");
  command->add_option("--frame-delay-us", faults.frame_delay_us, "For how long, in microseconds")
      ->group("Faults, to test clients");
  command->add_option("--fault-seed", faults.seed, "Seed of the faults")->group("Faults, to test clients");
  command->footer(
      "Examples:\n"
      "  atomcam serve\n"
      "  atomcam serve my_lab.toml --set atoms.filling=0.9\n"
      "  atomcam serve ixon-ultra-897 --address 127.0.0.5 --loss 0.02\n"
      "  atomcam serve orca-quest --replay 16");
  command->callback([options] { run_command("serve", [&] { run(*options); }); });
}

}  // namespace atomcam
