// CPU time of whole frames on one core: the paper's scene on a full 512 x 512 EMCCD and a full 4096 x 2304
// qCMOS. With a command that renders the same frames another way (its last argument is the number of frames),
// both are timed in turns and the ratio is printed.
//
//   frames_bench [--emccd-baseline "COMMAND"] [--qcmos-baseline "COMMAND"] [--rounds N]
//   frames_bench --effects

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "simulation/simulation.hpp"

namespace {

using namespace atomcam;

double seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

double own_cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// CPU seconds of `command frames`.
double command_cpu_s(const std::string& command, int frames) {
  const std::string line = command + " " + std::to_string(frames) + " >/dev/null";
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", line.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  wait4(child, &status, 0, &usage);
  if (status != 0) {
    std::fprintf(stderr, "frames_bench: '%s' failed\n", line.c_str());
    std::exit(1);
  }
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// The paper's published settings: 306 sites half filled, 30,000 photons/s, 0.2 registered stray photons/s.
Lab scene(const char* camera) {
  Lab lab = preset(camera);
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.scene.filling = 0.5;
  lab.scene.survival = 1;
  lab.scene.scattering_rate_hz = 30000;
  const double quantum_efficiency =
      std::visit([](const auto& sensor) { return sensor.quantum_efficiency; }, lab.sensor);
  lab.stray_light_photons_per_s = 0.2 / quantum_efficiency;
  return lab;
}

void measure(const char* camera, const std::string& baseline, int frames, int baseline_frames, int rounds,
             double flicker_noise_e = 0) {
  Lab lab = scene(camera);
  if (auto* sensor = std::get_if<QcmosDescription>(&lab.sensor)) sensor->flicker_noise_e = flicker_noise_e;
  const double setup_began = own_cpu_s();
  const Simulation simulation(lab);
  simulation.render(0);
  const double setup_s = own_cpu_s() - setup_began;
  double best = 1e9, best_baseline = 1e9;
  std::uint64_t number = 1;
  for (int round = 0; round < rounds; ++round) {
    const double began = own_cpu_s();
    for (int n = 0; n < frames; ++n) simulation.render(number++);
    best = std::min(best, (own_cpu_s() - began) / frames);
    if (!baseline.empty())
      best_baseline = std::min(
          best_baseline,
          (command_cpu_s(baseline, baseline_frames + 1) - command_cpu_s(baseline, 1)) / baseline_frames);
  }
  const Shape shape = lab.sensor_shape();
  std::printf("%-15s %d x %d, %zu sites: %8.3f ms CPU per frame, %7.1f frames/s per core (setup %.2f s)\n",
              camera, shape.columns, shape.rows, lab.scene.sites.size(), 1e3 * best, 1 / best, setup_s);
  if (!baseline.empty())
    std::printf("%-15s baseline %.3f ms CPU per frame: %.0f times as long\n", "", 1e3 * best_baseline,
                best_baseline / best);
  std::fflush(stdout);
}

/// What each effect adds to a full frame, and all of the sensor's together; at their declared strengths.
void measure_effects(const char* camera) {
  const Lab plain = scene(camera);
  const Simulation base(plain);
  const auto frame_s = [&](const Lab& lab) {
    const Simulation simulation(lab, base);
    simulation.render(0);
    double best = 1e9;
    for (std::uint64_t n = 1; n <= 3; ++n) {
      const double began = own_cpu_s();
      simulation.render(n);
      best = std::min(best, own_cpu_s() - began);
    }
    return best;
  };
  Lab sensor = plain;
  sensor.effects.clear();
  Lab none = sensor;
  const double plain_s = frame_s(none);
  std::printf("%s without effects: %.1f ms CPU per frame; each effect adds\n", camera, 1e3 * plain_s);
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (!(plain.kind() == CameraKind::emccd ? effect.emccd : effect.qcmos)) continue;
    ParameterValues values;
    for (const ParameterDeclaration& parameter : effect.parameters) values.push_back(parameter.default_value);
    Lab with = none;
    with.effects[effect.name] = values;
    if (effect.stage() == "sensor") sensor.effects[effect.name] = values;
    std::printf("  %-30s %8.1f ms\n", effect.name.c_str(), 1e3 * (frame_s(with) - plain_s));
  }
  std::printf("  all effects of the sensor      %8.1f ms\n", 1e3 * (frame_s(sensor) - plain_s));
}

}  // namespace

int main(int count, char** arguments) {
  std::string emccd, qcmos;
  int rounds = 3;
  for (int i = 1; i + 1 < count; i += 2) {
    const std::string option = arguments[i];
    if (option == "--emccd-baseline") emccd = arguments[i + 1];
    if (option == "--qcmos-baseline") qcmos = arguments[i + 1];
    if (option == "--rounds") rounds = std::max(1, std::atoi(arguments[i + 1]));
  }
  if (count == 2 && std::string(arguments[1]) == "--effects") {
    measure_effects("ixon-ultra-897");
    measure_effects("orca-quest");
    return 0;
  }
  measure("ixon-ultra-897", emccd, 300, 5, rounds);
  measure("orca-quest", qcmos, 15, 1, rounds);
  std::printf("the same with the 0.01 e- of flicker noise that the paper's published settings add:\n");
  measure("orca-quest", {}, 15, 1, rounds, 0.01);
}
