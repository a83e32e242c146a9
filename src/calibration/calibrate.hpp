#pragma once
// Lab parameters from frames, with errors: the paper's section "Fitting Parameter Values", automatic.

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"
#include "calibration/atom_fit.hpp"
#include "calibration/notes.hpp"
#include "calibration/optics_fit.hpp"
#include "calibration/photon_transfer.hpp"
#include "calibration/sensor_fit.hpp"
#include "data/kept_results.hpp"
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
  double background_exposure_s = 0;           // 0: that of the frames
  /// Evenly lit frames at several levels, same settings, with what each was exposed (0: not known); they need
  /// darks.
  struct Flats {
    const FrameSequence* frames = nullptr;
    double exposure = 0;
  };
  std::vector<Flats> flats = {};
  /// Beyond the plain model: serial clock-induced charge, the brightness of each site, maps of pixels.
  bool full = false;
  /// The frames that are used: n such that use(n); empty: all.
  std::function<bool(std::size_t)> use;
  std::function<void(std::string_view step, double done)> progress;
  /// A calibration of a stack much like this one, to start from; the model then has its figures only.
  const struct Calibration* like = nullptr;
  int threads = 0;  // 0: as many as the machine has cores
  /// Where the fit of the optics is kept for the next calibration to the same frames; null: nowhere.
  const KeptResults* kept = nullptr;
};

/// Of each pixel, from dark frames; the offset includes the dark current of the exposure.
struct PixelMaps {
  Image<double, unit::counts> offset, offset_error, noise, noise_error;  // empty: not fitted
  struct HotPixel {
    int row = 0, column = 0;
    double excess_counts = 0, noise_counts = 0;  // mean above the median pixel; rms in time
  };
  std::vector<HotPixel> hot;
};

/// Light that grows with the exposure and charge that does not, from two exposures.
struct ExposureSplit {
  double offset_e = 0, offset_error = 0;            // clock-induced charge, e per pixel and frame
  double rate_e_per_s = 0, rate_error_e_per_s = 0;  // dark current and stray light
};

struct Calibration {
  Lab lab;           // the plain model at the fitted values
  StackModel model;  // of that lab
  std::vector<CalibratedParameter> parameters;
  CountFit counts;         // EMCCD
  QcmosDarkFit dark_maps;  // qCMOS
  OpticsFit optics;
  MeanImage mean_image;  // that the optics were fitted to
  AtomFit atoms;
  std::vector<double> site_brightness;        // mean light of each site relative to the mean over sites
  std::vector<double> site_brightness_error;  // full model
  PixelMaps maps;                             // full model with darks
  std::optional<ExposureSplit> exposures;     // background at another exposure
  std::optional<PhotonTransfer> flats;
  std::vector<std::string> warnings;
  bool has_sites = false;
  double counts_per_electron_error = 0;  // 0: taken from the notes
  double background_error = 0;           // e per pixel and frame; 0: that of the optics' fit
};

/// The plain model fitted to a stack. Throws Error for stacks that cannot be what the notes say (shape,
/// saturated, no frames).
Calibration calibrate(const CalibrationInput& input);

}  // namespace atomcam
