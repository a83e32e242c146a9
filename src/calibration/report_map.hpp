#pragma once
// Maps as small PNG images within a page.

#include <span>
#include <string>

#include "base/image.hpp"
#include "data/canvas.hpp"

namespace atomcam::report {

enum class Palette {
  sequential,  // dark to light
  diverging    // blue below the middle, white, orange above
};

/// t from 0 to 1.
Colour colour_of(Palette palette, double t);

struct Scale {
  double low = 0, high = 1;
};
/// From the quantiles 0.5 % and 99.5 % of all finite values; symmetrical about 0 if `diverging`.
Scale scale_of(std::span<const std::span<const double>> maps, bool diverging);

/// <figure> with image, colour bar and caption. `title` and `caption` are text; NaN is drawn grey. A large
/// map is averaged down.
std::string map_figure(const std::string& title, const std::string& caption, std::span<const double> values,
                       Shape shape, Scale scale, Palette palette, const std::string& unit, int side_px = 240);

}  // namespace atomcam::report
