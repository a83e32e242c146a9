// Sensor part of a frame, light already landed. CPU time; run with nothing else on the core.

#include <benchmark/benchmark.h>

#include "base/random.hpp"
#include "sensor/sensor.hpp"

namespace atomcam {
namespace {

/// `sites` atoms of `electrons` each, spread with an rms of 1.5 pixels about places on a grid.
PhotoElectrons atoms(Shape plane, int sites, int electrons) {
  RandomStream random(1, stream_id("bench/atoms"), 0, 0);
  std::vector<std::vector<std::uint16_t>> rows(static_cast<std::size_t>(plane.rows));
  for (int site = 0; site < sites; ++site) {
    const double y = 8 + random.uniform() * (plane.rows - 16),
                 x = 8 + random.uniform() * (plane.columns - 16);
    for (int e = 0; e < electrons; ++e) {
      const auto spread = [&] { return (random.uniform() + random.uniform() + random.uniform() - 1.5) * 3; };
      const auto row = static_cast<std::size_t>(y + spread());
      rows[row].push_back(static_cast<std::uint16_t>(x + spread()));
    }
  }
  PhotoElectrons result;
  for (const auto& row : rows) {
    result.row_begin.push_back(static_cast<std::uint32_t>(result.columns.size()));
    result.columns.insert(result.columns.end(), row.begin(), row.end());
  }
  result.row_begin.push_back(static_cast<std::uint32_t>(result.columns.size()));
  return result;
}

EmccdDescription emccd() {
  EmccdDescription description;
  description.readout_modes = {{Amplifier::electron_multiplying, ScanMode::standard, 17e6, "1x", 15, 240}};
  return description;
}

QcmosDescription qcmos() {
  QcmosDescription description;
  description.offset_sigma_counts = 0.5;
  description.column_gumbel_counts = 0.2;
  description.row_offset_sigma_counts = 0.2;
  description.gain_sigma = 0.005;
  description.row_noise_e = 0.02;
  description.readout_modes = {{Amplifier::conventional, ScanMode::standard, 0, "1x", 0.107, 0.43}};
  return description;
}

CameraSettings whole(Shape shape, double temperature_c) {
  CameraSettings settings;
  settings.region = {0, 0, shape.columns, shape.rows};
  settings.sensor_temperature_c = temperature_c;
  return settings;
}

void read_frames(benchmark::State& state, const Sensor& sensor, const CameraSettings& settings,
                 const SensorLight& light) {
  CountImage counts(sensor.begin(settings, light, 1, 0)->plane_shape());
  std::uint64_t frame = 0;
  for (auto _ : state) {
    const auto readout = sensor.begin(settings, light, 1, frame++);
    for (int row = 0; row < counts.rows(); ++row) readout->read_row(row, counts.row(row));
    benchmark::DoNotOptimize(counts.pixels().data());
  }
  state.counters["ns/pixel"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * static_cast<double>(counts.pixels().size()) / 1e9,
      benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void emccd_frame(benchmark::State& state) {
  const auto sensor = make_emccd(emccd(), "bench");
  CameraSettings settings = whole(sensor->shape(), -80);
  SensorLight light;
  light.background_e = 0.2;
  light.atoms = atoms(sensor->shape(), 150, 267);
  read_frames(state, *sensor, settings, light);
}

/// The same by planes, with serial clock-induced charge.
void emccd_frame_with_serial_charge(benchmark::State& state) {
  const auto sensor = make_emccd(emccd(), "bench");
  CameraSettings settings = whole(sensor->shape(), -80);
  SensorLight light;
  light.background_e = 0.2;
  light.atoms = atoms(sensor->shape(), 150, 267);
  CountImage counts(sensor->shape());
  std::vector<std::int32_t> electrons(static_cast<std::size_t>(counts.columns()));
  std::vector<float> output(electrons.size());
  std::uint64_t frame = 0;
  for (auto _ : state) {
    const auto readout = sensor->begin(settings, light, 1, frame++);
    for (int row = 0; row < counts.rows(); ++row) {
      readout->collect(row, electrons);
      readout->multiply(row, electrons, output);
      readout->add_serial_clock_induced_charge(row, 0.01, output);
      readout->amplify(row, output, output);
      readout->digitise(row, output, counts.row(row));
    }
    benchmark::DoNotOptimize(counts.pixels().data());
  }
}

void qcmos_frame(benchmark::State& state) {
  QcmosDescription description = qcmos();
  description.flicker_noise_e = static_cast<double>(state.range(0)) * 0.01;
  const auto sensor = make_qcmos(description, "bench");
  SensorLight light;
  light.background_e = 0.2;
  light.atoms = atoms(sensor->shape(), 150, 267);
  read_frames(state, *sensor, whole(sensor->shape(), -35), light);
}

/// Stray light that follows a map.
void qcmos_frame_with_background_map(benchmark::State& state) {
  const auto sensor = make_qcmos(qcmos(), "bench");
  auto ratio = std::make_shared<RatioMap>(sensor->shape());
  for (int r = 0; r < ratio->rows(); ++r)
    for (int c = 0; c < ratio->columns(); ++c) (*ratio)(r, c) = 0.5f + static_cast<float>(c) / 4096;
  SensorLight light;
  light.background_e = 0.2;
  light.background_ratio = ratio;
  read_frames(state, *sensor, whole(sensor->shape(), -35), light);
}

void qcmos_maps(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(make_qcmos(qcmos(), "bench"));
}

void em_gain_tables(benchmark::State& state) {
  const auto sensor = make_emccd(emccd(), "bench");
  CameraSettings settings = whole(sensor->shape(), -80);
  settings.em_gain = static_cast<double>(state.range(0));
  for (auto _ : state) {
    settings.em_gain *= 1.0001;  // never the same twice
    benchmark::DoNotOptimize(sensor->begin(settings, {}, 1, 0));
  }
}

void random_words(benchmark::State& state) {
  std::vector<std::uint32_t> words(4096);
  std::uint64_t frame = 0;
  for (auto _ : state) {
    fill_random({1, 2}, frame++, 0, words);
    benchmark::DoNotOptimize(words.data());
  }
  state.counters["ns/word"] = benchmark::Counter(static_cast<double>(state.iterations()) * 4096 / 1e9,
                                                 benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

BENCHMARK(random_words);
BENCHMARK(emccd_frame)->Unit(benchmark::kMillisecond);
BENCHMARK(emccd_frame_with_serial_charge)->Unit(benchmark::kMillisecond);
BENCHMARK(qcmos_frame)->ArgName("flicker")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);
BENCHMARK(qcmos_frame_with_background_map)->Unit(benchmark::kMillisecond);
BENCHMARK(qcmos_maps)->Unit(benchmark::kMillisecond);
BENCHMARK(em_gain_tables)->ArgName("gain")->Arg(2)->Arg(300)->Arg(1000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace atomcam

BENCHMARK_MAIN();
