#pragma once
// What stands beside the pixels of a stack about how they came about: the settings of StackNotes, JSON.

#include <cstdint>
#include <string>

#include "simulation/lab.hpp"

namespace atomcam {

struct StackSettings {
  std::string command;  // "render", "grab"
  std::string camera;   // model
  std::string serial;
  std::uint64_t seed = 0;
  std::uint64_t first_frame = 0;
  double exposure_s = 0;
  int offset_x = 0, offset_y = 0;  // physical pixels
  int binning_x = 1, binning_y = 1;
  double em_gain = 1;              // 1: off or none
  double electrons_per_count = 0;  // 0: unknown
  double bias_counts = 0;
  std::string pixel_format = "Mono16";

  std::string to_json() const;
  /// Throws an Error at `place`.
  static StackSettings parse(const std::string& json, const std::string& place);
  static StackSettings of(const Lab& lab);
};

}  // namespace atomcam
