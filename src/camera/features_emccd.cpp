// Features of an electron-multiplying CCD, as the iXon Ultra 897 has them.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "camera/declare.hpp"

namespace atomcam {

namespace {

constexpr double largest_gain = 300;  // without EMAdvanced
constexpr double largest_advanced_gain = 1000;
constexpr int largest_binning = 16;

std::string rate_name(double hz) {
  return hz >= 1e6 ? fmt::format("Rate{:g}MHz", hz / 1e6) : fmt::format("Rate{:g}kHz", hz / 1e3);
}

// Names of entries are identifiers: "2.4x" -> "Gain2_4x".
std::string preamp_name(std::string label) {
  for (char& letter : label)
    if (!std::isalnum(static_cast<unsigned char>(letter))) letter = '_';
  return "Gain" + label;
}

std::vector<double> distinct_rates(const CameraModel& model) {
  std::vector<double> rates;
  for (const ReadoutMode& mode : model.readout_modes) rates.push_back(mode.pixel_rate_hz);
  std::sort(rates.rbegin(), rates.rend());
  rates.erase(std::unique(rates.begin(), rates.end()), rates.end());
  return rates;
}

std::vector<std::string> distinct_preamps(const CameraModel& model) {
  std::vector<std::string> labels;
  for (const ReadoutMode& mode : model.readout_modes)
    if (std::find(labels.begin(), labels.end(), mode.preamp) == labels.end()) labels.push_back(mode.preamp);
  return labels;
}

Amplifier amplifier(const FeatureState& s) {
  return s.is("Amplifier", "Conventional") ? Amplifier::conventional : Amplifier::electron_multiplying;
}

int readout_mode(const FeatureState& s) {
  const auto& modes = s.model().readout_modes;
  const double rate = s.number("ReadoutRate");
  const auto preamp = static_cast<std::size_t>(s.entry_position("PreampGain"));
  const std::string label = distinct_preamps(s.model())[preamp];
  for (std::size_t i = 0; i < modes.size(); ++i)
    if (modes[i].amplifier == amplifier(s) && modes[i].pixel_rate_hz == rate && modes[i].preamp == label)
      return static_cast<int>(i);
  throw Error("ReadoutRate",
              fmt::format("{} Hz with preamp {} is no readout mode of this camera", rate, label));
}

const ReadoutMode& mode_in_force(const FeatureState& s) {
  return s.model().readout_modes[static_cast<std::size_t>(readout_mode(s))];
}

// Written binning keeps the place on the sensor; an image that fills the sensor goes on filling it.
auto rebin(const char* size, const char* offset, const char* binning, int pixels) {
  return [=](FeatureState& s, double value) {
    const double old = s.number(binning);
    const bool full = s.number(size) == std::floor(pixels / old);
    s.store(size, full ? std::floor(pixels / value) : std::floor(s.number(size) * old / value));
    s.store(offset, std::floor(s.number(offset) * old / value));
    return value;
  };
}

}  // namespace

void add_emccd_cooling(FeatureTable& table, const CameraModel& model) {
  table.add(Declare::enumeration("SensorCooling", "Thermoelectric cooler.", {{"Off", 0, ""}, {"On", 1, ""}})
                .custom()
                .initially(1));
  table.add(Declare::floating("SensorTemperatureSetpoint", "Temperature that the cooler holds.")
                .custom()
                .unit("C")
                .within(-100, 20)
                .initially(model.power_up.sensor_temperature_c));
}

void add_emccd_image_format(FeatureTable& table, const CameraModel& model) {
  const Shape sensor = model.sensor;
  table.add(Declare::integer("BinningHorizontal", "Columns that are added on the chip.")
                .within(1, largest_binning)
                .initially(model.power_up.binning_x)
                .held_while_acquiring()
                .on_write(rebin("Width", "OffsetX", "BinningHorizontal", sensor.columns)));
  table.add(Declare::integer("BinningVertical", "Rows that are added on the chip.")
                .within(1, largest_binning)
                .initially(model.power_up.binning_y)
                .held_while_acquiring()
                .on_write(rebin("Height", "OffsetY", "BinningVertical", sensor.rows)));
  add_region(table, model, 1, largest_binning);
  table.add(Declare::enumeration("PixelFormat", "Format of a pixel.",
                                 {{"Mono16", static_cast<std::int64_t>(PixelFormat::mono16), ""}})
                .initially(static_cast<double>(PixelFormat::mono16))
                .held_while_acquiring());
}

void add_emccd_readout(FeatureTable& table, const CameraModel& model) {
  const CameraSettings& power_up = model.power_up;
  const ReadoutMode& initial = model.readout_modes.at(static_cast<std::size_t>(power_up.readout_mode));
  const auto conventional = [](const FeatureState& s) { return amplifier(s) == Amplifier::conventional; };

  table.add(Declare::enumeration("Amplifier", "Output amplifier.",
                                 {{"ElectronMultiplying", 0, "behind the EM register"},
                                  {"Conventional", 1, "without EM register"}})
                .custom()
                .held_while_acquiring()
                .initially(initial.amplifier == Amplifier::conventional ? 1 : 0)
                .choices([](const FeatureState& s) {
                  std::uint64_t mask = 0;
                  for (const ReadoutMode& mode : s.model().readout_modes)
                    mask |= mode.amplifier == Amplifier::conventional ? 2 : 1;
                  return mask;
                }));

  const std::vector<double> rates = distinct_rates(model);
  std::vector<EnumEntry> rate_entries;
  for (const double rate : rates) rate_entries.push_back({rate_name(rate), std::llround(rate), ""});
  table.add(Declare::enumeration("ReadoutRate", "Pixels per second out of the serial register.",
                                 std::move(rate_entries))
                .custom()
                .held_while_acquiring()
                .initially(initial.pixel_rate_hz)
                .choices([rates](const FeatureState& s) {
                  std::uint64_t mask = 0;
                  for (const ReadoutMode& mode : s.model().readout_modes)
                    for (std::size_t i = 0; i < rates.size(); ++i)
                      if (mode.amplifier == amplifier(s) && mode.pixel_rate_hz == rates[i])
                        mask |= std::uint64_t{1} << i;
                  return mask;
                }));

  const std::vector<std::string> preamps = distinct_preamps(model);
  std::vector<EnumEntry> preamp_entries;
  for (std::size_t i = 0; i < preamps.size(); ++i)
    preamp_entries.push_back(
        {preamp_name(preamps[i]), static_cast<std::int64_t>(i), "preamplifier " + preamps[i]});
  const auto initial_preamp = std::find(preamps.begin(), preamps.end(), initial.preamp) - preamps.begin();
  table.add(Declare::enumeration("PreampGain",
                                 "Gain of the preamplifier; ElectronsPerCount tells what it makes.",
                                 std::move(preamp_entries))
                .custom()
                .initially(static_cast<double>(initial_preamp))
                .choices([preamps](const FeatureState& s) {
                  std::uint64_t mask = 0;
                  for (const ReadoutMode& mode : s.model().readout_modes)
                    for (std::size_t i = 0; i < preamps.size(); ++i)
                      if (mode.amplifier == amplifier(s) && mode.pixel_rate_hz == s.number("ReadoutRate") &&
                          mode.preamp == preamps[i])
                        mask |= std::uint64_t{1} << i;
                  return mask;
                }));

  std::vector<EnumEntry> shifts = {{"Shift0_3us", 300, ""},
                                   {"Shift0_5us", 500, ""},
                                   {"Shift0_9us", 900, ""},
                                   {"Shift1_7us", 1700, ""},
                                   {"Shift3_3us", 3300, ""}};
  const auto initial_shift_ns = std::llround(power_up.vertical_shift_s * 1e9);
  if (std::none_of(shifts.begin(), shifts.end(),
                   [&](const EnumEntry& e) { return e.value == initial_shift_ns; }))
    shifts.push_back({fmt::format("Shift{}ns", initial_shift_ns), initial_shift_ns, ""});
  table.add(
      Declare::enumeration("VerticalShiftSpeed", "Time of a vertical shift by one row.", std::move(shifts))
          .custom()
          .held_while_acquiring()
          .initially(static_cast<double>(initial_shift_ns)));
  table.add(
      Declare::boolean("FrameTransfer",
                       "Whether a frame exposes while the one before it is read out of the storage area.")
          .custom()
          .held_while_acquiring()
          .initially(power_up.frame_transfer));

  table.add(Declare::enumeration("EMGainMode", "Scale of the EM gain. Both give the multiplication itself.",
                                 {{"Linear", 2, "linear"}, {"RealGain", 3, "linear and calibrated"}})
                .custom()
                .expert()
                .initially(3));
  table.add(Declare::boolean("EMAdvanced", "Allows EM gains above 300, which age the register.")
                .custom()
                .expert()
                .initially(power_up.em_gain > largest_gain));
  const auto gain_range = [](const FeatureState& s) {
    return FeatureRange{1, s.on("EMAdvanced") ? largest_advanced_gain : largest_gain, 0};
  };
  table.add(Declare::floating("Gain", "EM gain: mean multiplication of an electron in the register; 1: off.")
                .within(1, largest_advanced_gain)
                .initially(power_up.em_gain)
                .logarithmic()
                .range(gain_range)
                .locked_if(conventional));
  table.add(Declare::floating("EMGain", "The same as Gain, under the maker's name.")
                .custom()
                .within(1, largest_advanced_gain)
                .logarithmic()
                .not_saved()
                .range(gain_range)
                .locked_if(conventional)
                .number([](const FeatureState& s) { return s.number("Gain"); })
                .on_write([](FeatureState& s, double value) {
                  s.store("Gain", value);
                  return value;
                }));
  table.add(
      Declare::floating("BlackLevel", "Mean counts of a pixel without charge (baseline clamp and offset).")
          .unit("DN")
          .within(0, 2000)
          .initially(power_up.bias_counts));
  table.add(Declare::floating("ElectronsPerCount", "Electrons at the output amplifier per count.")
                .custom()
                .expert()
                .within(0, 1000)
                .read_only()
                .number([](const FeatureState& s) { return mode_in_force(s).electrons_per_count; }));
  table.add(Declare::floating("ReadNoise",
                              "Noise of the output amplifier, rms electrons, as the data sheet gives it.")
                .custom()
                .expert()
                .within(0, 10000)
                .read_only()
                .number([](const FeatureState& s) { return mode_in_force(s).read_noise_e; }));
}

CameraSettings emccd_settings(const FeatureState& s, CameraSettings settings) {
  settings.readout_mode = readout_mode(s);
  settings.em_gain = s.number("Gain");
  const double shift_ns = s.number("VerticalShiftSpeed");
  if (shift_ns != static_cast<double>(std::llround(s.model().power_up.vertical_shift_s * 1e9)))
    settings.vertical_shift_s = shift_ns / 1e9;
  settings.frame_transfer = s.on("FrameTransfer");
  return settings;
}

FrameTiming emccd_timing(const FeatureState& s, const CameraSettings& settings) {
  return emccd_timing(s.model().sensor, settings, s.number("ReadoutRate"));
}

}  // namespace atomcam
