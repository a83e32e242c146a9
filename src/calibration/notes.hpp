#pragma once
// What an experimenter wrote down: set-points and data-sheet figures, tens of percent off. The one place
// where their keys are mapped to a lab.

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "simulation/lab.hpp"

namespace atomcam {

/// Where the sites are thought to be: the top left one to about a pixel.
struct NotedGrid {
  int rows = 0, columns = 0;
  double spacing_px = 0;
  double first_x_px = 0, first_y_px = 0;
  double angle_deg = 0;
};

/// Notes as JSON or TOML, keys:
///   camera            model name; an "iXon", "EMCCD" or an em_gain above 1 is an EMCCD, else a qCMOS
///   shape             [rows, columns] of the frames
///   settings          exposure_s, em_gain, preamp_e_per_adu, bias_adu, read_noise_adu, quantum_efficiency,
///                     dark_e_per_s, cic_e, pixel_um, magnification, numerical_aperture, wavelength_um,
///                     scattering_rate_hz, stray_e_per_s, transmission, filling, survival, temperature_c,
///                     frame_interval_s; serial_cic, row_noise_adu, flicker_noise_e: zero if not given
///   site_grid         rows, cols, spacing_px, first_site_px [x, y], angle_deg; or none: no sites
///   remark            prose
struct Notes {
  std::string place;  // file, for errors
  std::string camera;
  CameraKind kind = CameraKind::emccd;
  Shape shape;
  double exposure_s = 0.08;
  double frame_interval_s = 0;  // 0: not noted
  double em_gain = 1;
  double electrons_per_count = 1;
  double bias_counts = 200;
  double read_noise_counts = 4;
  double quantum_efficiency = 0.85;
  double dark_e_per_s = 0;
  double clock_induced_charge_e = 0;
  double pixel_um = 16;
  double magnification = 1;
  double numerical_aperture = 0.65;
  double wavelength_um = 0.461;
  double transmission = 1;
  double scattering_rate_hz = 30000;
  double stray_e_per_s = 0;
  double filling = 0.5;
  double survival = 0.97;
  double serial_cic_events = 0;
  double row_noise_counts = 0;
  double flicker_noise_e = 0;
  std::optional<NotedGrid> grid;
  std::vector<std::string> not_understood;  // keys that were left alone
};

/// By extension .toml, else JSON. Errors name file, key, value and what is allowed.
Notes read_notes(const std::filesystem::path& file);
Notes parse_notes(std::string_view text, std::string_view place, bool toml = false);

/// The plain model at the noted values: no effects beyond those the notes give, sites where they were noted.
Lab lab_of_notes(const Notes& notes);

/// Frames tell the counts per electron, hardly which part of them the register makes: of a fitted gain beyond
/// what a lab may have the rest is left to the preamplifier.
void share_gain(Lab& lab);

}  // namespace atomcam
