// Features of a quantitative CMOS camera, as the ORCA-Quest has them.

#include <cmath>

#include "base/error.hpp"
#include "camera/declare.hpp"

namespace atomcam {

namespace {

// With water: cooler on, cooler at its most.
constexpr double cooled_c = -20;
constexpr double most_cooled_c = -35;

constexpr int region_step_px = 4;

bool resolving(const FeatureState& s) {
  return s.is("SensorMode", "PhotonNumberResolving");
}

ScanMode scan_in_force(const FeatureState& s) {
  return s.is("ScanMode", "Standard") ? ScanMode::standard : ScanMode::ultra_quiet;
}

int mode_with(const CameraModel& model, ScanMode scan) {
  for (std::size_t i = 0; i < model.readout_modes.size(); ++i)
    if (model.readout_modes[i].scan == scan) return static_cast<int>(i);
  return -1;
}

const ReadoutMode& mode_in_force(const FeatureState& s) {
  return s.model().readout_modes[static_cast<std::size_t>(mode_with(s.model(), scan_in_force(s)))];
}

// Exposures come in steps of two line times of the scan.
void realise_exposure(FeatureState& s, ScanMode scan) {
  const FrameTiming timing = qcmos_timing(s.settings(), scan);
  s.store("ExposureTime", timing.realised_exposure_s(s.number("ExposureTime") / 1e6) * 1e6);
}

}  // namespace

void add_qcmos_cooling(FeatureTable& table, const CameraModel& model) {
  const double initial = model.power_up.sensor_temperature_c;
  const bool most = initial < (cooled_c + most_cooled_c) / 2;
  table.add(Declare::enumeration("SensorCooling", "Thermoelectric cooler with water.",
                                 {{"Off", 0, ""}, {"On", 1, "-20 C"}, {"Max", 2, "-35 C"}})
                .custom()
                .initially(most ? 2 : 1));
  table.add(Declare::floating("SensorTemperatureSetpoint", "Temperature that the cooler holds.")
                .custom()
                .unit("C")
                .within(-100, ambient_temperature_c)
                .read_only()
                .number([initial, most](const FeatureState& s) {
                  const double level = s.number("SensorCooling");
                  if (level == 0) return ambient_temperature_c;
                  if (level == 1) return most ? cooled_c : initial;
                  return most ? initial : most_cooled_c;
                }));
}

void add_qcmos_image_format(FeatureTable& table, const CameraModel& model) {
  const Shape sensor = model.sensor;
  // The camera has one binning for both axes.
  const auto rebin = [sensor](FeatureState& s, double value) {
    if (value == 3) return std::nan("");
    const double old = s.number("BinningHorizontal");
    const auto along = [&](const char* size, const char* offset, int pixels) {
      const bool full = s.number(size) == std::floor(pixels / old);
      s.store(size, full ? std::floor(pixels / value) : std::floor(s.number(size) * old / value));
      s.store(offset, std::floor(s.number(offset) * old / value));
    };
    along("Width", "OffsetX", sensor.columns);
    along("Height", "OffsetY", sensor.rows);
    s.store("BinningHorizontal", value);
    s.store("BinningVertical", value);
    return value;
  };
  table.add(Declare::integer("BinningHorizontal",
                             "Columns that are added after conversion: 1, 2 or 4, as vertically.")
                .within(1, 4)
                .initially(model.power_up.binning_x)
                .held_while_acquiring()
                .on_write(rebin));
  table.add(
      Declare::integer("BinningVertical", "Rows that are added after conversion: 1, 2 or 4, as horizontally.")
          .within(1, 4)
          .initially(model.power_up.binning_y)
          .held_while_acquiring()
          .on_write(rebin));
  add_region(table, model, region_step_px, region_step_px);
  const auto entry = [](const char* name, PixelFormat format, const char* tooltip) {
    return EnumEntry{name, static_cast<std::int64_t>(format), tooltip};
  };
  table.add(Declare::enumeration("PixelFormat",
                                 "Format of a pixel; fewer bits carry the most significant ones.",
                                 {entry("Mono16", PixelFormat::mono16, ""),
                                  entry("Mono12", PixelFormat::mono12, "counts / 16"),
                                  entry("Mono12Packed", PixelFormat::mono12_packed, "counts / 16"),
                                  entry("Mono12p", PixelFormat::mono12p, "counts / 16"),
                                  entry("Mono8", PixelFormat::mono8, "counts / 256")})
                .initially(static_cast<double>(PixelFormat::mono16))
                .held_while_acquiring());
}

void add_qcmos_readout(FeatureTable& table, const CameraModel& model) {
  const CameraSettings& power_up = model.power_up;
  const ReadoutMode& initial = model.readout_modes.at(static_cast<std::size_t>(power_up.readout_mode));
  const bool quiet = initial.scan == ScanMode::ultra_quiet || power_up.photon_number_resolving;
  const auto in_resolving = [](const FeatureState& s) { return resolving(s); };

  table.add(Declare::enumeration("SensorMode", "What a pixel's number means.",
                                 {{"Area", 1, "counts"},
                                  {"PhotonNumberResolving", 18, "photo-electrons, in ultra-quiet scan"}})
                .custom()
                .held_while_acquiring()
                .initially(power_up.photon_number_resolving ? 18 : 1)
                .choices([](const FeatureState& s) {
                  return std::uint64_t{mode_with(s.model(), ScanMode::ultra_quiet) < 0 ? 1u : 3u};
                })
                .on_write([](FeatureState& s, double value) {
                  if (value == 18) realise_exposure(s, ScanMode::ultra_quiet);
                  return value;
                }));
  table.add(Declare::enumeration(
                "ScanMode", "Speed of the readout.",
                {{"UltraQuiet", 1, "86.4 us per row, least noise"}, {"Standard", 2, "3.6 us per row"}})
                .custom()
                .held_while_acquiring()
                .initially(quiet ? 1 : 2)
                .choices([](const FeatureState& s) {
                  std::uint64_t mask = 0;
                  if (mode_with(s.model(), ScanMode::ultra_quiet) >= 0) mask |= 1;
                  if (mode_with(s.model(), ScanMode::standard) >= 0) mask |= 2;
                  return resolving(s) ? mask & 1 : mask;
                })
                .on_write([](FeatureState& s, double value) {
                  realise_exposure(s, value == 2 ? ScanMode::standard : ScanMode::ultra_quiet);
                  return value;
                }));
  table.add(Declare::boolean("DefectCorrection",
                             "Replaces known defective pixels; not when resolving photon numbers.")
                .custom()
                .initially(power_up.defect_correction)
                .locked_if(in_resolving)
                .number([](const FeatureState& s) {
                  return resolving(s) ? 0 : s.selected_number("DefectCorrection", 0);
                }));
  const auto hot = power_up.hot_pixel_correction;
  table.add(Declare::enumeration("HotPixelCorrectionLevel", "How readily a bright pixel counts as hot.",
                                 {{"Standard", 1, ""}, {"Minimum", 2, ""}, {"Aggressive", 3, ""}})
                .custom()
                .initially(hot == HotPixelCorrection::standard  ? 1
                           : hot == HotPixelCorrection::minimum ? 2
                                                                : 3));
  table.add(Declare::floating("BlackLevel", "Mean counts of a dark pixel; fixed.")
                .unit("DN")
                .within(0, 65535)
                .initially(power_up.bias_counts)
                .read_only());
  table.add(Declare::floating("ElectronsPerCount", "Electrons per count.")
                .custom()
                .expert()
                .within(0, 1000)
                .read_only()
                .number([](const FeatureState& s) { return mode_in_force(s).electrons_per_count; }));
  table.add(Declare::floating("ReadNoise", "Read noise, rms electrons, as the data sheet gives it.")
                .custom()
                .expert()
                .within(0, 10000)
                .read_only()
                .number([](const FeatureState& s) { return mode_in_force(s).read_noise_e; }));
}

CameraSettings qcmos_settings(const FeatureState& s, CameraSettings settings) {
  settings.readout_mode = mode_with(s.model(), scan_in_force(s));
  settings.photon_number_resolving = resolving(s);
  settings.defect_correction = s.on("DefectCorrection");
  settings.hot_pixel_correction = s.is("HotPixelCorrectionLevel", "Standard") ? HotPixelCorrection::standard
                                  : s.is("HotPixelCorrectionLevel", "Minimum")
                                      ? HotPixelCorrection::minimum
                                      : HotPixelCorrection::aggressive;
  settings.pulsed_light = s.on("PulsedLight");
  return settings;
}

FrameTiming qcmos_timing(const FeatureState& s, const CameraSettings& settings) {
  return qcmos_timing(settings, scan_in_force(s));
}

}  // namespace atomcam
