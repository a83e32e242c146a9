#include "sensor/qcmos.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/error.hpp"
#include "base/math.hpp"
#include "base/samplers.hpp"
#include "sensor/background.hpp"
#include "sensor/dark_map.hpp"
#include "sensor/defects.hpp"
#include "sensor/fixed_map.hpp"
#include "sensor/photo_electrons.hpp"
#include "sensor/readout_settings.hpp"
#include "sensor/recent.hpp"
#include "sensor/row_loops.hpp"
#include "sensor/word_laws.hpp"

namespace atomcam {
namespace {

class Qcmos final : public Sensor {
 public:
  Qcmos(QcmosDescription description, const QcmosMaps& maps)
      : description_(std::move(description)),
        offset_counts_(*maps.offset_counts),
        gain_ratio_(*maps.gain_ratio),
        read_noise_ratio_(*maps.read_noise_ratio),
        dark_(maps.dark_ratio) {}

  CameraKind kind() const override { return CameraKind::qcmos; }
  Shape shape() const override { return description_.shape; }
  double quantum_efficiency() const override { return description_.quantum_efficiency; }
  double pixel_um() const override { return description_.pixel_um; }
  std::span<const ReadoutMode> readout_modes() const override { return description_.readout_modes; }
  std::unique_ptr<Readout> begin(const CameraSettings& settings, const SensorLight& light, std::uint64_t seed,
                                 std::uint64_t frame) const override;

 private:
  class QcmosReadout;

  std::shared_ptr<const std::vector<Defect>> defects(HotPixelCorrection level) const {
    return defects_.get(level, [&] { return find_defects(read_noise_ratio_, dark_.ratio(), level); });
  }

  QcmosDescription description_;
  FixedMap<std::int16_t> offset_counts_;
  FixedMap<std::uint16_t> gain_ratio_;
  FixedMap<std::uint16_t> read_noise_ratio_;
  DarkMap dark_;
  mutable Background::Cache background_cache_;
  mutable Recent<HotPixelCorrection, std::vector<Defect>> defects_{3};
};

/// Refers to its sensor, which outlives it.
class Qcmos::QcmosReadout final : public Sensor::Readout {
 public:
  QcmosReadout(const Qcmos& sensor, const CameraSettings& settings, const SensorLight& light,
               std::uint64_t seed, std::uint64_t frame)
      : sensor_(sensor),
        settings_(settings),
        plane_{settings.region.height, settings.region.width},
        atoms_(light.atoms, plane_),
        background_(sensor.background_cache_, plane_, 0, light.background_e, light.background_ratio, seed,
                    frame),
        frame_(frame),
        dark_key_(stream_key(seed, stream_id("sensor/dark_electrons"))),
        noise_key_(stream_key(seed, stream_id("sensor/read_noise"))),
        row_noise_key_(stream_key(seed, stream_id("sensor/row_noise"))),
        flicker_key_(stream_key(seed, stream_id("sensor/flicker"))) {
    const QcmosDescription& description = sensor.description_;
    const ReadoutMode& mode = readout_mode_of(settings, description.readout_modes);
    well_e_ = static_cast<std::int32_t>(description.full_well_e);
    conversion_.largest_count = static_cast<float>((1 << description.adc_bits) - 1);
    electrons_per_count_ = static_cast<float>(mode.electrons_per_count);
    conversion_.bias_counts = static_cast<float>(settings.bias_counts);
    conversion_.counts_per_e = static_cast<float>(1 / mode.electrons_per_count);
    conversion_.read_noise_e = static_cast<float>(mode.read_noise_e);
    conversion_.flicker_noise_e = static_cast<float>(description.flicker_noise_e);
    dark_e_ = description.dark_rate_e_per_s * settings.exposure_s *
              math::exp((settings.sensor_temperature_c - description.dark_reference_c) /
                        description.dark_doubling_c * 0.69314718055994531);
  }

  Shape plane_shape() const override { return plane_; }

  void collect(int row, std::span<std::int32_t> electrons) const override {
    background_.fill(row, electrons);
    atoms_.add(row, electrons);
    sensor_.dark_.add(RandomStream(dark_key_, frame_, static_cast<std::uint32_t>(row)),
                      settings_.region.offset_y + row, settings_.region.offset_x, dark_e_, electrons);
    row_loops::clip(well_e_, electrons);
  }

  void multiply(int, std::span<const std::int32_t> electrons, std::span<float> output_e) const override {
    for (std::size_t c = 0; c < electrons.size(); ++c) output_e[c] = static_cast<float>(electrons[c]);
  }

  void add_serial_clock_induced_charge(int, double, std::span<float>) const override {}  // no serial register

  void amplify(int row, std::span<const float> output_e, std::span<float> analog_counts) const override {
    const Words words = words_of(row, output_e.size());
    row_loops::qcmos_amplify(row_conversion(row), output_e, words.noise, words.flicker, analog_counts);
  }

  void read_noise(int row, std::span<float> noise_e) const override {
    const row_loops::QcmosConversion conversion = row_conversion(row);
    const std::uint32_t* words = words_of(row, noise_e.size()).noise;
    for (std::size_t c = 0; c < noise_e.size(); ++c)
      noise_e[c] = word_laws::normal(words[c]) * conversion.read_noise_ratio[c] * conversion.read_noise_e;
  }

  void digitise(int row, std::span<const float> analog_counts,
                std::span<std::uint16_t> counts) const override {
    row_loops::digitise(analog_counts, conversion_.largest_count, counts);
    if (settings_.photon_number_resolving) resolve_photons(row, counts);
  }

  void read_row(int row, std::span<std::uint16_t> counts) const override {
    thread_local std::vector<std::int32_t> electrons;
    electrons.resize(counts.size());
    collect(row, electrons);
    const Words words = words_of(row, counts.size());
    row_loops::qcmos_convert(row_conversion(row), electrons, words.noise, words.flicker, counts);
    if (settings_.photon_number_resolving) resolve_photons(row, counts);
  }

  CountImage finish(CountImage converted) const override {
    if (settings_.defect_correction && !settings_.photon_number_resolving)
      correct_defects(*sensor_.defects(settings_.hot_pixel_correction), settings_.region, converted);
    return bin_digitally(std::move(converted), settings_.binning_x, settings_.binning_y);
  }
  bool finishes() const override {
    return (settings_.defect_correction && !settings_.photon_number_resolving) || settings_.binning_x > 1 ||
           settings_.binning_y > 1;
  }

 private:
  struct Words {
    const std::uint32_t* noise;
    const std::uint32_t* flicker;
  };
  /// Of the row's noise; valid until this thread asks again.
  Words words_of(int row, std::size_t columns) const {
    thread_local std::vector<std::uint32_t> noise, flicker;
    const auto block = static_cast<std::uint32_t>(row);
    noise.resize(columns);
    fill_random(noise_key_, frame_, block, noise);
    if (conversion_.flicker_noise_e == 0) return {noise.data(), nullptr};
    flicker.resize(columns);
    fill_random(flicker_key_, frame_, block, flicker);
    return {noise.data(), flicker.data()};
  }

  void resolve_photons(int row, std::span<std::uint16_t> counts) const {
    // The camera knows its own pixels: offset and gain are calibrated out before the count of electrons is
    // rounded.
    const row_loops::QcmosConversion conversion = row_conversion(row);
    for (std::size_t c = 0; c < counts.size(); ++c) {
      const float zero = conversion.bias_counts + conversion.offset_counts[c];
      const float electrons =
          (static_cast<float>(counts[c]) - zero) * electrons_per_count_ / conversion.gain_ratio[c];
      counts[c] = static_cast<std::uint16_t>(std::nearbyint(std::clamp(electrons, 0.0f, 65535.0f)));
    }
  }

  row_loops::QcmosConversion row_conversion(int row) const {
    const int r = settings_.region.offset_y + row, c = settings_.region.offset_x;
    row_loops::QcmosConversion conversion = conversion_;
    conversion.offset_counts = sensor_.offset_counts_.row(r, c);
    conversion.gain_ratio = sensor_.gain_ratio_.row(r, c);
    conversion.read_noise_ratio = sensor_.read_noise_ratio_.row(r, c);
    if (sensor_.description_.row_noise_e != 0)
      conversion.row_noise_e =
          static_cast<float>(sensor_.description_.row_noise_e) *
          word_laws::normal(RandomStream(row_noise_key_, frame_, static_cast<std::uint32_t>(row))());
    return conversion;
  }

  const Qcmos& sensor_;
  CameraSettings settings_;
  Shape plane_;
  PhotoElectronRows atoms_;
  Background background_;
  std::uint64_t frame_;
  PhiloxKey dark_key_, noise_key_, row_noise_key_, flicker_key_;
  double dark_e_ = 0;
  std::int32_t well_e_ = 0;
  float electrons_per_count_ = 1;
  row_loops::QcmosConversion conversion_;
};

std::unique_ptr<Sensor::Readout> Qcmos::begin(const CameraSettings& settings, const SensorLight& light,
                                              std::uint64_t seed, std::uint64_t frame) const {
  check_region(settings, description_.shape);
  return std::make_unique<QcmosReadout>(*this, settings, light, seed, frame);
}

template <class Map>
void check_map(const std::shared_ptr<const Map>& map, Shape shape, const char* name) {
  if (map != nullptr && map->shape() != shape)
    throw Error(name, fmt::format("{} x {} pixels; the sensor has {} x {}", map->columns(), map->rows(),
                                  shape.columns, shape.rows));
}

}  // namespace

std::shared_ptr<const Sensor> make_qcmos(QcmosDescription description, std::string serial, QcmosMaps maps) {
  check_map(maps.offset_counts, description.shape, "offset_counts");
  check_map(maps.gain_ratio, description.shape, "gain_ratio");
  check_map(maps.read_noise_ratio, description.shape, "read_noise_ratio");
  check_map(maps.dark_ratio, description.shape, "dark_ratio");
  if (!maps.offset_counts || !maps.gain_ratio || !maps.read_noise_ratio || !maps.dark_ratio) {
    const QcmosMaps drawn = draw_qcmos_maps(description, serial);
    if (!maps.offset_counts) maps.offset_counts = drawn.offset_counts;
    if (!maps.gain_ratio) maps.gain_ratio = drawn.gain_ratio;
    if (!maps.read_noise_ratio) maps.read_noise_ratio = drawn.read_noise_ratio;
    if (!maps.dark_ratio) maps.dark_ratio = drawn.dark_ratio;
  }
  return std::make_shared<Qcmos>(std::move(description), maps);
}

std::shared_ptr<const Sensor> make_qcmos(QcmosDescription description, std::string serial) {
  return make_qcmos(std::move(description), std::move(serial), {});
}

}  // namespace atomcam
