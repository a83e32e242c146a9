#pragma once
// A preset is a list of figures: key, value, source. The lab, its comments and docs/cameras.md come from it.

#include <span>
#include <string_view>

#include "simulation/lab.hpp"

namespace atomcam {

struct Figure {
  std::string_view key;
  double value = 0;
  std::string_view source;
};

struct ModeFigure {
  ReadoutMode mode;
  std::string_view source;
};

/// An effect that the preset switches on; its other parameters are as declared.
struct EffectFigure {
  std::string_view name;
  double strength = 0;
  std::string_view source;
};

struct Preset {
  std::string_view name;
  std::string_view lab_name;
  std::string_view serial;
  std::string_view user_name;
  Lab (*blank)();                   // a lab of the right kind of camera and layout
  std::span<const Figure> figures;  // every scalar but the effects'
  std::span<const ModeFigure> modes;
  std::size_t mode = 0;                   // at power-up
  std::span<const EffectFigure> effects;  // switched on; the others are off
};

const Preset& ixon_ultra_897();
const Preset& orca_quest();

/// lab_parameters(kind) before its defaults are known: they are the preset's values.
std::span<const LabParameter> lab_parameters_without_defaults(CameraKind kind);

}  // namespace atomcam
