#pragma once
// The readout mode is one row of the sensor's table; files and people name it by its columns.

#include <optional>
#include <span>
#include <string>
#include <string_view>

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

/// A figure of a readout mode, by the name it has in a lab file.
struct ReadoutFigure {
  ParameterDeclaration declaration;
  double ReadoutMode::*member;
};
std::span<const ReadoutFigure> readout_figures();
/// Of the mode in force.
double readout_figure(const Lab& lab, std::string_view name);
/// Throws an Error at `place` if the name is none or the value out of range.
void set_readout_figure(Lab& lab, std::string_view name, double value, std::string_view place);

}  // namespace atomcam
