#pragma once
// In which ways the image of a site may differ from the one that the model expects.

#include <array>
#include <string_view>

#include "analysis/layout.hpp"

namespace atomcam::analysis {

/// Derivatives of the image, by what they do to it.
enum ImageChange { shift_x, shift_y, width_x, width_y, diagonal, coma_x, coma_y, second_ring };
inline constexpr std::array<std::string_view, 8> image_change_names = {
    "x", "y", "width_x", "width_y", "diagonal", "coma_x", "coma_y", "second_ring"};
template <class T>
using OfImageChange = std::array<T, image_change_names.size()>;

/// Each change over the site's stamp, weighed by the pixels' noise; norm: its product with itself.
struct ShapeTemplates {
  ShapeTemplates(const Layout& layout, const PackedSite& packed);

  OfImageChange<Floats> weighed;
  OfImageChange<double> norm{};
};

}  // namespace atomcam::analysis
