#pragma once
// What a site's pixels are multiplied with, frame after frame: how far its image has moved and how much wider
// it is, and the noise in it.

#include <cstddef>

#include "analysis/layout.hpp"

namespace atomcam::analysis {

/// The site's share in a pixel of its stamp, and its Laplacian, counts; nothing beyond the stamp.
double share_at(const PackedSite& packed, int row, int column);
double laplacian_at(const PackedSite& packed, int row, int column);

/// Each over the stamp, per photon and read noise together; norms are sums of a template's own products.
struct StampTemplates {
  StampTemplates(const Layout& layout, const PackedSite& packed);

  Floats x, y;        // the image's slopes
  Floats width;       // it gets wider: blind to its brightness and to a level
  Floats atom_width;  // likewise, and to the errors that noise makes in the brightness
  Floats core, wing;
  double norm_x = 0, norm_y = 0, norm_width = 0, norm_atom_width = 0;
};

struct StampSums {
  float x = 0, y = 0, width = 0, atom_width = 0, core = 0, wing = 0, cube = 0;
};

/// Sums over a stamp of what `light` has beside `mean` (both from the stamp's first pixel on, counts), times
/// the templates; squares and cubes of it in core and wing. response += change * what it has beside.
StampSums add_stamp(const PackedSite& packed, const StampTemplates& templates, const float* light,
                    const float* mean, std::ptrdiff_t stride, float change, float* response);

}  // namespace atomcam::analysis
