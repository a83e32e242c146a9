#pragma once
// The readout mode is one row of the sensor's table; files and people name it by its columns.

#include <optional>
#include <string>

#include "simulation/lab.hpp"

namespace atomcam {

/// The columns that were asked for; the others stay as near to the mode in force as the table allows.
struct ReadoutWish {
  std::optional<std::string> amplifier;
  std::optional<std::string> scan;
  std::optional<std::string> rate_hz;
  std::optional<std::string> preamp;
};

/// Throws an Error at `place`, with the modes there are, if none fits.
void choose_readout_mode(Lab& lab, const ReadoutWish& wish, std::string_view place);
std::string readout_mode_name(CameraKind kind, const ReadoutMode& mode);

}  // namespace atomcam
