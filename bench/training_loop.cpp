// The loop that bench/training_bench.py holds Python against: frames of a lab with their truth, kept in
// memory, on one thread. Prints the CPU seconds of the loop.
//
//   training_loop LAB FRAMES

#include <sys/resource.h>

#include <cstdio>
#include <cstdlib>
#include <vector>

#include "simulation/simulation.hpp"

namespace {

double own_cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) return 2;
  const auto frames = static_cast<std::uint64_t>(std::atoll(arguments[2]));
  const atomcam::Simulation simulation(atomcam::read_lab(arguments[1]));
  simulation.render(0);
  const double began = own_cpu_s();
  std::vector<atomcam::Frame> kept;
  kept.reserve(frames);
  for (std::uint64_t n = 0; n < frames; ++n) kept.push_back(simulation.render(n));
  std::printf("%.6f %u\n", own_cpu_s() - began, static_cast<unsigned>(kept.back().counts(0, 0)));
}
