#include "calibration/calibration_json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace atomcam {

nlohmann::ordered_json calibration_json(const Calibration& calibration) {
  using Json = nlohmann::ordered_json;
  const auto number = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
  Json parameters = Json::array();
  for (const CalibratedParameter& one : calibration.parameters) {
    const bool pulls = one.error > 0 && std::isfinite(one.noted);
    parameters.push_back({{"key", one.key},
                          {"unit", one.unit},
                          {"noted", number(one.noted)},
                          {"fitted", number(one.fitted)},
                          {"error", one.error > 0 ? number(one.error) : Json(nullptr)},
                          {"pull", pulls ? number(one.pull()) : Json(nullptr)},
                          {"from_notes", one.from_notes}});
  }
  Json fits = Json::array();
  const auto fit = [&](const char* what, double chi_square, int count) {
    if (count > 0) fits.push_back({{"fit", what}, {"chi_square", number(chi_square)}, {"points", count}});
  };
  fit("histogram of counts", calibration.counts.chi_square, calibration.counts.bins);
  if (calibration.has_sites) {
    fit("mean image", calibration.optics.chi_square, calibration.optics.degrees_of_freedom);
    fit("histogram of site brightness", calibration.atoms.chi_square, calibration.atoms.bins);
  }
  Json out = {{"parameters", std::move(parameters)},
              {"goodness_of_fit", std::move(fits)},
              {"warnings", calibration.warnings}};
  if (!calibration.site_brightness_error.empty()) {
    Json sites = Json::array();
    for (std::size_t s = 0; s < calibration.site_brightness_error.size(); ++s)
      sites.push_back({{"brightness", number(calibration.site_brightness[s])},
                       {"error", number(calibration.site_brightness_error[s])}});
    out["site_brightness"] = std::move(sites);
  }
  if (!calibration.maps.offset.pixels().empty()) {
    Json hot = Json::array();
    for (const PixelMaps::HotPixel& one : calibration.maps.hot)
      hot.push_back({{"row", one.row},
                     {"column", one.column},
                     {"excess_counts", number(one.excess_counts)},
                     {"noise_counts", number(one.noise_counts)}});
    out["hot_pixels"] = std::move(hot);
  }
  if (calibration.flats) {
    Json levels = Json::array();
    for (const FlatLevel& level : calibration.flats->levels)
      levels.push_back({{"exposure", level.exposure > 0 ? number(level.exposure) : Json(nullptr)},
                        {"signal_counts", number(level.signal_counts)},
                        {"variance_counts", number(level.variance_counts)},
                        {"variance_error", number(level.variance_error)},
                        {"saturated", level.saturated}});
    out["flats"] = {{"slope", number(calibration.flats->slope)},
                    {"slope_error", number(calibration.flats->slope_error)},
                    {"levels", std::move(levels)}};
  }
  return out;
}

}  // namespace atomcam
