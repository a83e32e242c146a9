#include "sensor/readout_settings.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace atomcam {

const ReadoutMode& readout_mode_of(const CameraSettings& settings, std::span<const ReadoutMode> modes) {
  const auto index = static_cast<std::size_t>(settings.readout_mode);
  if (settings.readout_mode < 0 || index >= modes.size())
    throw Error("readout_mode",
                fmt::format("{} is not one of the {} modes of the sensor, 0 to {}", settings.readout_mode,
                            modes.size(), static_cast<int>(modes.size()) - 1));
  const ReadoutMode& mode = modes[index];
  if (!(mode.electrons_per_count > 0))
    throw Error("electrons_per_count", fmt::format("{} is not above 0", mode.electrons_per_count));
  if (!(mode.read_noise_e >= 0)) throw Error("read_noise_e", fmt::format("{} is below 0", mode.read_noise_e));
  return mode;
}

void check_region(const CameraSettings& settings, Shape sensor) {
  const Region& region = settings.region;
  if (settings.binning_x < 1 || settings.binning_y < 1)
    throw Error("binning", fmt::format("{} x {}; each at least 1", settings.binning_x, settings.binning_y));
  if (region.offset_x < 0 || region.offset_y < 0 || region.width < 1 || region.height < 1 ||
      region.width > sensor.columns - region.offset_x || region.height > sensor.rows - region.offset_y)
    throw Error("region",
                fmt::format("{} x {} at ({}, {}) does not lie on the sensor of {} x {} pixels", region.width,
                            region.height, region.offset_x, region.offset_y, sensor.columns, sensor.rows));
  if (region.width % settings.binning_x != 0 || region.height % settings.binning_y != 0)
    throw Error("region", fmt::format("{} x {} is not a multiple of the binning {} x {}", region.width,
                                      region.height, settings.binning_x, settings.binning_y));
}

}  // namespace atomcam
