// How long photons take to land, and tables to build. The scene is the paper's experiment: 306 sites, 229
// photons each.

#include <benchmark/benchmark.h>

#include <vector>

#include "base/random.hpp"
#include "optics/optics.hpp"

namespace atomcam {
namespace {

OpticsDescription papers_optics() {
  OpticsDescription optics;
  optics.zernike_um = {0,           0,           0,           0.07232454,  0.00087644,
                       -0.01069755, 0.00280808,  0.00723265,  0.00436401,  0.00117688,
                       0.02449155,  -0.00427388, -0.00250116, -0.00477205, -0.00054310};
  return optics;
}

void draw_photons(benchmark::State& state) {
  const PointSpreadFunction psf(papers_optics());
  std::vector<std::uint32_t> words(1 << 15);
  std::vector<PointSpreadFunction::Displacement> landed(words.size() / 2);
  fill_random(stream_key(1, 1), 0, 0, words);
  for (auto _ : state) {
    psf.draw(words, landed);
    benchmark::DoNotOptimize(landed.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(landed.size()));
}
BENCHMARK(draw_photons);

void random_words_and_draw(benchmark::State& state) {
  const PointSpreadFunction psf(papers_optics());
  std::vector<std::uint32_t> words(1 << 9);
  std::vector<PointSpreadFunction::Displacement> landed(words.size() / 2);
  std::uint64_t frame = 0;
  for (auto _ : state) {
    fill_random(stream_key(1, 1), ++frame, 0, words);
    psf.draw(words, landed);
    benchmark::DoNotOptimize(landed.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(landed.size()));
}
BENCHMARK(random_words_and_draw);

void build_table(benchmark::State& state) {
  OpticsDescription optics = papers_optics();
  optics.zernike_um[3] = static_cast<double>(state.range(0)) / 1000;
  for (auto _ : state) benchmark::DoNotOptimize(PointSpreadFunction(optics));
}
BENCHMARK(build_table)->ArgName("defocus_nm")->Arg(0)->Arg(72)->Arg(300)->Unit(benchmark::kMillisecond);

void expected_image_of_one_atom(benchmark::State& state) {
  const PointSpreadFunction psf(papers_optics());
  PhotonImage image(Shape{512, 512});
  double x = 200;
  for (auto _ : state) psf.add_expected(image, 1, x += 0.01, 251.3);
}
BENCHMARK(expected_image_of_one_atom)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace atomcam

BENCHMARK_MAIN();
