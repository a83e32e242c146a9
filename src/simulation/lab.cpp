#include "simulation/lab.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"

namespace atomcam {
namespace {

void check_axis(std::string_view place, const char* axis, int offset, int size, int binning, int sensor) {
  const std::string region =
      "region from " + std::to_string(offset) + ", " + std::to_string(size) + " px along " + axis;
  if (size < 1 || offset < 0 || size > sensor - offset) {
    throw Error(place, region + "; allowed within the sensor's " + std::to_string(sensor) + " px");
  }
  if (offset % binning != 0 || size % binning != 0) {
    throw Error(place, region + "; allowed multiples of the binning, " + std::to_string(binning));
  }
}

}  // namespace

Shape Lab::sensor_shape() const {
  return std::visit([](const auto& description) { return description.shape; }, sensor);
}

void Lab::place_sites() {
  optics.pixel_um = std::visit([](const auto& description) { return description.pixel_um; }, sensor);
  if (const auto* listed = std::get_if<std::vector<Site>>(&layout)) {
    scene.sites = *listed;
    return;
  }
  const Shape shape = sensor_shape();
  scene.sites = grid_sites(std::get<SiteGrid>(layout), optics.magnification / optics.pixel_um,
                           (shape.columns - 1) * 0.5, (shape.rows - 1) * 0.5);
}

void check_lab(const Lab& lab, std::string_view place) {
  const Shape shape = lab.sensor_shape();
  const CameraSettings& settings = lab.settings;
  check_axis(place, "x", settings.region.offset_x, settings.region.width, settings.binning_x, shape.columns);
  check_axis(place, "y", settings.region.offset_y, settings.region.height, settings.binning_y, shape.rows);
  if (lab.kind() == CameraKind::qcmos) {
    for (const int binning : {settings.binning_x, settings.binning_y}) {
      if (binning != 1 && binning != 2 && binning != 4) {
        throw Error(place, "binning " + std::to_string(binning) + " of a qCMOS; allowed 1, 2, 4");
      }
    }
  }
  const std::size_t modes =
      std::visit([](const auto& description) { return description.readout_modes.size(); }, lab.sensor);
  if (settings.readout_mode < 0 || static_cast<std::size_t>(settings.readout_mode) >= modes) {
    throw Error(place, "readout mode " + std::to_string(settings.readout_mode) + "; the sensor has " +
                           std::to_string(modes));
  }
  const std::size_t sites = lab.scene.sites.size();
  for (std::size_t shot = 0; shot < lab.given_occupancies.size(); ++shot) {
    const std::size_t length = lab.given_occupancies[shot].size();
    if (length != sites) {
      throw Error(place, "occupancy " + std::to_string(shot + 1) + " has " + std::to_string(length) +
                             " sites; allowed one digit for each of the " + std::to_string(sites) + " sites");
    }
  }
}

}  // namespace atomcam
