#pragma once
// Lab parameters from frames, with errors: the paper's section "Fitting Parameter Values", automatic.

#include <functional>
#include <string>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"
#include "calibration/atom_fit.hpp"
#include "calibration/notes.hpp"
#include "calibration/optics_fit.hpp"
#include "calibration/sensor_fit.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

/// One row of the calibration's table.
struct CalibratedParameter {
  std::string key;  // lab file key, or a product such as "camera.em_gain / electrons_per_count"
  std::string unit;
  double noted = 0;
  double fitted = 0;
  double error = 0;  // 1 sigma; 0: taken from the notes
  bool from_notes = false;
  double pull() const { return error > 0 ? (fitted - noted) / error : 0; }
};

struct CalibrationInput {
  Notes notes;
  const FrameSequence* frames = nullptr;
  const FrameSequence* darks = nullptr;       // shutter closed, same settings
  const FrameSequence* background = nullptr;  // shutter open, no atoms
  /// The frames that are used: n such that use(n); empty: all.
  std::function<bool(std::size_t)> use;
  std::function<void(std::string_view step, double done)> progress;
  /// A calibration of a stack much like this one, to start from.
  const struct Calibration* like = nullptr;
};

struct Calibration {
  Lab lab;           // the plain model at the fitted values
  StackModel model;  // of that lab
  std::vector<CalibratedParameter> parameters;
  CountFit counts;         // EMCCD
  QcmosDarkFit dark_maps;  // qCMOS
  OpticsFit optics;
  AtomFit atoms;
  std::vector<double> site_brightness;  // mean light of each site relative to the mean over sites
  std::vector<std::string> warnings;
  bool has_sites = false;
  double counts_per_electron_error = 0;  // 0: taken from the notes
  double background_error = 0;           // e per pixel and frame, of a stack without sites
};

/// The plain model fitted to a stack. Throws Error for stacks that cannot be what the notes say (shape,
/// saturated, no frames).
Calibration calibrate(const CalibrationInput& input);

}  // namespace atomcam
