#pragma once
// What the plain model expects of a stack: enough to measure a real and a simulated one alike. Calibration
// fills it from the real frames; the same model then measures every simulated stack it is compared with.

#include <vector>

#include "base/image.hpp"

namespace atomcam {

/// One site's image: its expected share of light per pixel and the weights that estimate its light in a
/// frame.
struct SiteImage {
  double x_px = 0, y_px = 0;          // in the frames' pixels, columns and rows
  int grid_column = 0, grid_row = 0;  // place in the lattice
  int left = 0, top = 0;              // of the stamp, within the frame
  RatioMap share;                     // stamp [row, column]: fraction of the site's light in each pixel
  /// Electrons of the site's atom in a frame = sum over the stamp of weight * (counts - bias - background) /
  /// counts_per_electron; neighbours are already taken out (least squares over all sites).
  RatioMap weight;
};

/// The law of a dark pixel's counts, and the ways in which another calibration would change it: from first +
/// k counts on, k = 0 ... size - 1.
struct ExpectedCounts {
  int first = 0;
  std::vector<double> probability;
  std::vector<std::vector<double>> directions;  // derivatives of the probability
};

struct StackModel {
  Shape shape;
  double bias_counts = 0;
  double read_noise_counts = 1;
  double counts_per_electron = 1;  // em_gain / electrons_per_count for an EMCCD
  double excess_noise = 1;         // F^2 of the amplification: 2 for an EM register, 1 without
  double dark_e = 0;               // mean events per pixel and frame with the shutter closed
  double background_e = 0;         // mean photo-electrons of stray light per pixel and frame
  double atom_e = 0;               // photo-electrons of an atom that stays
  double filling = 0;
  std::vector<SiteImage> sites;  // may be empty
  /// Expected site light summed over all sites at unit amplitude (a site's whole light = 1), whole frame.
  PhotonImage site_light;
  /// Of dark pixels with the shutter open and closed; empty without an EM register.
  ExpectedCounts expected_light, expected_dark;
};

}  // namespace atomcam
