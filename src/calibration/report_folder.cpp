#include "calibration/report_folder.hpp"

#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "calibration/calibration_json.hpp"
#include "calibration/report.hpp"
#include "data/npy.hpp"
#include "data/output_files.hpp"

namespace atomcam {
namespace {

void write_map(const std::filesystem::path& file, const Image<double, unit::counts>& map) {
  if (map.empty()) return;
  const std::vector<float> values(map.pixels().begin(), map.pixels().end());
  NpyWriter writer(file, map.shape(), "<f4");
  writer.append(std::as_bytes(std::span(values)));
  writer.close();
}

}  // namespace

void write_calibration(const std::filesystem::path& folder, const Calibration& calibration,
                       const CalibrationInput& input, const std::string& command) {
  write_text(folder / "calibration.json", calibration_json(calibration).dump(2) + "\n");
  write_map(folder / "offset_counts.npy", calibration.maps.offset);
  write_map(folder / "offset_error_counts.npy", calibration.maps.offset_error);
  write_map(folder / "noise_counts.npy", calibration.maps.noise);
  write_map(folder / "noise_error_counts.npy", calibration.maps.noise_error);
  write_text(folder / "report.html", calibration_report(calibration, input, command));
}

}  // namespace atomcam
