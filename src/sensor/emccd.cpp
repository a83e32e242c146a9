#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/math.hpp"
#include "base/samplers.hpp"
#include "sensor/background.hpp"
#include "sensor/photo_electrons.hpp"
#include "sensor/readout_settings.hpp"
#include "sensor/recent.hpp"
#include "sensor/register_law.hpp"
#include "sensor/row_loops.hpp"
#include "sensor/sensor.hpp"
#include "sensor/word_laws.hpp"

namespace atomcam {
namespace {

/// Laws depend on gain and stages alone: one store for all sensors, as many labs of the same camera are
/// simulated in turn.
Recent<std::pair<double, int>, RegisterLaw>& register_laws() {
  static Recent<std::pair<double, int>, RegisterLaw> laws(32);
  return laws;
}

/// What a thread works with, kept from row to row.
struct Scratch {
  row_loops::Packets packets;
  std::vector<std::uint32_t> words, noise;
  std::vector<std::int32_t> electrons;
  std::vector<float> output_e;
};

/// Not inline: in a shared library the compiler asks anew at every use where a thread's own variable is.
[[gnu::noinline]] Scratch& own_scratch() {
  thread_local Scratch scratch;
  return scratch;
}

class Emccd final : public Sensor {
 public:
  explicit Emccd(EmccdDescription description) : description_(std::move(description)) {}

  CameraKind kind() const override { return CameraKind::emccd; }
  Shape shape() const override { return description_.shape; }
  double quantum_efficiency() const override { return description_.quantum_efficiency; }
  double pixel_um() const override { return description_.pixel_um; }
  std::span<const ReadoutMode> readout_modes() const override { return description_.readout_modes; }
  std::unique_ptr<Readout> begin(const CameraSettings& settings, const SensorLight& light, std::uint64_t seed,
                                 std::uint64_t frame) const override;

 private:
  class EmccdReadout;

  /// Dark rate ~ exp(-activation / T): halves every 7 K or so.
  double dark_rate_e_per_s(double temperature_c) const {
    constexpr double zero_c = 273.15;
    if (!(temperature_c > -zero_c))
      throw Error("sensor_temperature_c", fmt::format("{} is below absolute zero", temperature_c));
    return description_.dark_rate_e_per_s *
           math::exp(-description_.dark_activation_k *
                     (1 / (temperature_c + zero_c) - 1 / (description_.dark_reference_c + zero_c)));
  }

  EmccdDescription description_;
  mutable Background::Cache background_cache_;
};

class Emccd::EmccdReadout final : public Sensor::Readout {
 public:
  EmccdReadout(const Emccd& sensor, const CameraSettings& settings, const SensorLight& light,
               std::uint64_t seed, std::uint64_t frame)
      : plane_{settings.output_height(), settings.output_width()},
        atoms_(light.atoms, plane_),
        background_(sensor.background_cache_, plane_,
                    (sensor.dark_rate_e_per_s(settings.sensor_temperature_c) * settings.exposure_s +
                     sensor.description_.clock_induced_charge_e) *
                        settings.binning_x * settings.binning_y,
                    light.background_e * settings.binning_x * settings.binning_y, light.background_ratio,
                    seed, frame),
        frame_(frame),
        register_key_(stream_key(seed, stream_id("sensor/register"))),
        large_key_(stream_key(seed, stream_id("sensor/register/large"))),
        serial_key_(stream_key(seed, stream_id("sensor/serial_charge"))),
        noise_key_(stream_key(seed, stream_id("sensor/read_noise"))) {
    const EmccdDescription& description = sensor.description_;
    const ReadoutMode& mode = readout_mode_of(settings, description.readout_modes);
    const double bins = settings.binning_x * settings.binning_y;
    well_e_ = static_cast<std::int32_t>(
        std::min(description.pixel_full_well_e * bins, description.register_full_well_e));
    output_well_e_ = static_cast<float>(description.register_full_well_e);
    conversion_.largest_count = static_cast<float>((1 << description.adc_bits) - 1);
    conversion_.bias_counts = static_cast<float>(settings.bias_counts);
    conversion_.counts_per_e = static_cast<float>(1 / mode.electrons_per_count);
    conversion_.read_noise_counts = static_cast<float>(mode.read_noise_e / mode.electrons_per_count);
    if (mode.amplifier == Amplifier::electron_multiplying)
      law_ = register_laws().get({settings.em_gain, description.register_stages},
                                 [&] { return RegisterLaw(settings.em_gain, description.register_stages); });
  }

  Shape plane_shape() const override { return plane_; }

  void collect(int row, std::span<std::int32_t> electrons) const override {
    background_.fill(row, electrons);
    atoms_.add(row, electrons);
    row_loops::clip(well_e_, electrons);
  }

  void multiply(int row, std::span<const std::int32_t> electrons, std::span<float> output_e) const override {
    if (law_ == nullptr || law_->gain() == 1) {
      for (std::size_t c = 0; c < electrons.size(); ++c)
        output_e[c] = std::min(static_cast<float>(electrons[c]), output_well_e_);
      return;
    }
    const auto block = static_cast<std::uint32_t>(row);
    Scratch& scratch = own_scratch();
    row_loops::Packets& packets = scratch.packets;
    std::vector<std::uint32_t>& words = scratch.words;
    row_loops::spread_electrons(electrons, output_well_e_, output_e, packets);
    std::size_t needed = 0;
    for (std::size_t i = 0; i < packets.count; ++i) needed += law_->words_for(packets.electrons[i]);
    words.resize(needed);
    fill_random(register_key_, frame_, block, words);
    auto next_word = [word = words.data()]() mutable { return *word++; };
    RandomStream large(large_key_, frame_, block);
    for (std::size_t i = 0; i < packets.count; ++i)
      output_e[static_cast<std::size_t>(packets.columns[i])] =
          std::min(law_->draw(packets.electrons[i], next_word, large), output_well_e_);
  }

  void add_serial_clock_induced_charge(int row, double events, std::span<float> output_e) const override {
    if (law_ == nullptr || !(events > 0)) return;
    RandomStream random(serial_key_, frame_, static_cast<std::uint32_t>(row));
    const std::uint64_t columns = output_e.size();
    const std::int64_t charges = sample_poisson(random, events * static_cast<double>(columns));
    for (std::int64_t i = 0; i < charges; ++i) {
      const std::size_t c = random() * columns >> 32;
      output_e[c] = std::min(output_e[c] + static_cast<float>(law_->draw_serial(random())), output_well_e_);
    }
  }

  void amplify(int row, std::span<const float> output_e, std::span<float> analog_counts) const override {
    row_loops::emccd_amplify(conversion_, output_e, noise_words(row, output_e.size()), analog_counts);
  }

  void read_noise(int row, std::span<float> noise_e) const override {
    const std::uint32_t* words = noise_words(row, noise_e.size());
    const float scale_e = conversion_.read_noise_counts / conversion_.counts_per_e;
    for (std::size_t c = 0; c < noise_e.size(); ++c) noise_e[c] = word_laws::normal(words[c]) * scale_e;
  }

  void digitise(int, std::span<const float> analog_counts, std::span<std::uint16_t> counts) const override {
    row_loops::digitise(analog_counts, conversion_.largest_count, counts);
  }

  void read_row(int row, std::span<std::uint16_t> counts) const override {
    Scratch& scratch = own_scratch();
    std::vector<std::int32_t>& electrons = scratch.electrons;
    std::vector<float>& output_e = scratch.output_e;
    electrons.resize(counts.size());
    output_e.resize(counts.size());
    collect(row, electrons);
    multiply(row, electrons, output_e);
    row_loops::emccd_convert(conversion_, output_e, noise_words(row, counts.size()), counts);
  }

  CountImage finish(CountImage converted) const override { return converted; }
  bool finishes() const override { return false; }

 private:
  const std::uint32_t* noise_words(int row, std::size_t columns) const {
    std::vector<std::uint32_t>& noise = own_scratch().noise;
    noise.resize(columns);
    fill_random(noise_key_, frame_, static_cast<std::uint32_t>(row), noise);
    return noise.data();
  }

  Shape plane_;
  PhotoElectronRows atoms_;
  Background background_;
  std::uint64_t frame_;
  PhiloxKey register_key_, large_key_, serial_key_, noise_key_;
  std::int32_t well_e_ = 0;
  float output_well_e_ = 0;
  row_loops::EmccdConversion conversion_;
  std::shared_ptr<const RegisterLaw> law_;  // null: conventional amplifier
};

std::unique_ptr<Sensor::Readout> Emccd::begin(const CameraSettings& settings, const SensorLight& light,
                                              std::uint64_t seed, std::uint64_t frame) const {
  check_region(settings, description_.shape);
  return std::make_unique<EmccdReadout>(*this, settings, light, seed, frame);
}

}  // namespace

std::shared_ptr<const Sensor> make_emccd(EmccdDescription description, std::string /*serial*/) {
  return std::make_shared<Emccd>(std::move(description));
}

}  // namespace atomcam
