// The battery over stacks in memory: 300 light and 100 dark frames of 96 x 96 pixels.

#include <benchmark/benchmark.h>

#include <random>

#include "analysis/battery.hpp"

namespace atomcam {
namespace {

/// `sites` x `sites` sites with flat stamps, half of them lit.
StackModel model(int size, int sites) {
  StackModel result;
  result.shape = {size, size};
  result.bias_counts = 200;
  result.read_noise_counts = 4;
  result.counts_per_electron = 60;
  result.excess_noise = 2;
  result.background_e = 0.1;
  result.atom_e = 250;
  result.filling = 0.5;
  result.site_light = PhotonImage(result.shape);
  constexpr int edge = 11;
  for (int s = 0; s < sites * sites; ++s) {
    SiteImage site;
    site.grid_column = s % sites;
    site.grid_row = s / sites;
    site.left = site.grid_column * (size - edge) / std::max(sites - 1, 1);
    site.top = site.grid_row * (size - edge) / std::max(sites - 1, 1);
    site.x_px = site.left + edge / 2;
    site.y_px = site.top + edge / 2;
    site.share = RatioMap({edge, edge}, 1.0f / (edge * edge));
    site.weight = RatioMap({edge, edge}, 1.0f);
    for (int r = 0; r < edge; ++r)
      for (int c = 0; c < edge; ++c) result.site_light(site.top + r, site.left + c) += site.share(r, c);
    result.sites.push_back(site);
  }
  return result;
}

FramesInMemory frames(const StackModel& of, std::size_t count, bool darks) {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  std::exponential_distribution<float> gain(1 / static_cast<float>(of.counts_per_electron));
  std::vector<CountImage> stack;
  for (std::size_t n = 0; n < count; ++n) {
    CountImage image(of.shape);
    for (auto& pixel : image.pixels())
      pixel = static_cast<std::uint16_t>(200 + 4 * normal(random) + (random() % 16 ? 0 : gain(random)));
    if (!darks)
      for (const SiteImage& site : of.sites)
        if (random() % 2)
          for (int r = 0; r < site.share.rows(); ++r)
            for (int c = 0; c < site.share.columns(); ++c)
              image(site.top + r, site.left + c) =
                  static_cast<std::uint16_t>(image(site.top + r, site.left + c) + 120 + 20 * normal(random));
    stack.push_back(std::move(image));
  }
  return FramesInMemory(std::move(stack));
}

void measure_stack(benchmark::State& state) {
  const StackModel of = model(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  const auto light = frames(of, static_cast<std::size_t>(state.range(2)), false),
             darks = frames(of, static_cast<std::size_t>(state.range(3)), true);
  for (auto _ : state) benchmark::DoNotOptimize(measure(of, light, &darks));
  state.counters["statistics"] = static_cast<double>(battery(of, true).size());
}

BENCHMARK(measure_stack)
    ->ArgNames({"size", "sites", "light", "darks"})
    ->Args({96, 7, 300, 100})
    ->Args({512, 30, 100, 20})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace atomcam

BENCHMARK_MAIN();
