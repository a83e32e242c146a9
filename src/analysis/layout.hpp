#pragma once
// What a stack model means for the pixels: scales, weights and the sites' stamps, ready for the loops.

#include <cstdint>
#include <vector>

#include "analysis/plane.hpp"
#include "analysis/stack_model.hpp"

namespace atomcam::analysis {

/// Stamps with rows of a multiple of the lanes, zeros behind the site's own columns.
struct PackedSite {
  std::size_t offset = 0;  // of the first pixel in a plane
  int rows = 0, columns = 0;
  std::size_t width = 0;
  Floats share;             // counts per unit of brightness
  Floats weight;            // brightness per count
  double weight_sum = 0;    // of `weight`
  Floats slope_x, slope_y;  // of the share, counts per pixel
  Floats core, wing;        // squared weights of the chi-square in the bright part and around it
};

/// Brightness is in units of the model's atom_e throughout.
struct Layout {
  Layout(const StackModel& model, bool darks);

  PlaneShape shape;
  bool darks = false;
  float bias = 0;
  float read_noise = 1;    // counts
  float counts_per_e = 1;  // floored at a tiny value
  float background = 0;    // counts above the pedestal, expected without atoms
  /// Taken from every count. With an exponential tail the bias: most dark pixels hold no electron. Else the
  /// bias and the mean background.
  float pedestal = 0;
  /// What a dark pixel's clipping is measured in, counts: the read noise with an exponential tail, else all
  /// its noise.
  float dark_scale = 1;
  float atom_counts = 0;    // of a whole atom
  double white = 1;         // expected standard deviation of a dark pixel, counts
  bool multiplied = false;  // gain with excess noise: an exponential tail
  double filling = 0;
  ExpectedCounts expected;  // of a dark pixel; empty without an EM register
  std::vector<PackedSite> packed;
  std::vector<SiteImage> sites;
  /// 1 / scale on which a pixel is clipped (that of a dark pixel and, under the sites, shot noise), per
  /// count; zero in the margin.
  Plane inverse_scale;
  float inverse_scale_at(const PackedSite& site, int row, int column) const {
    return inverse_scale.all()[site.offset + static_cast<std::size_t>(row * shape.stride + column)];
  }
  /// Dark pixel's scale / that scale: near 1 on dark pixels, small under the sites; zero in the margin.
  Plane quiet;
  double quiet_sum = 0, quiet_square_sum = 0;
  /// Above this (in scales) a pixel holds more than the model has; huge in the margin.
  Plane event_threshold;
  double least_event = 1;                  // counts, of a dark pixel at that threshold
  float drive_cap = 12;                    // in scales: what counts of a bright pixel as a driver
  Plane site_light;                        // expected light of a frame relative to an atom
  std::vector<std::uint32_t> dark_pixels;  // indices into a frame: the least site light
};

}  // namespace atomcam::analysis
