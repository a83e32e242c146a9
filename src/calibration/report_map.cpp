#include "calibration/report_map.hpp"

#include <fmt/format.h>
#include <nettle/base64.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "calibration/report_page.hpp"
#include "data/png.hpp"

namespace atomcam::report {
namespace {

constexpr int largest_side = 256;  // pixels of a map in the page
constexpr Colour nothing = {205, 205, 205};

std::string data_uri(const Canvas& canvas) {
  const std::vector<std::byte> png = png_bytes(canvas);
  std::string text(BASE64_ENCODE_RAW_LENGTH(png.size()), '\0');
  base64_encode_raw(text.data(), png.size(), reinterpret_cast<const std::uint8_t*>(png.data()));
  return "data:image/png;base64," + text;
}

std::string image(const Canvas& canvas, int x, int y, int width, int height) {
  return fmt::format(
      "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" "
      "style=\"image-rendering: pixelated\" href=\"{}\"/>\n",
      x, y, width, height, data_uri(canvas));
}

}  // namespace

Colour colour_of(Palette palette, double t) {
  // Anchors evenly spaced; between them linear.
  static constexpr std::array<Colour, 5> sequential = {Colour{26, 22, 48}, Colour{74, 54, 120},
                                                       Colour{168, 74, 110}, Colour{228, 134, 84},
                                                       Colour{252, 236, 190}};
  static constexpr std::array<Colour, 5> diverging = {Colour{22, 74, 120}, Colour{130, 172, 206},
                                                      Colour{248, 248, 246}, Colour{232, 164, 116},
                                                      Colour{164, 66, 16}};
  const auto& anchors = palette == Palette::sequential ? sequential : diverging;
  const double at = std::clamp(t, 0.0, 1.0) * static_cast<double>(anchors.size() - 1);
  const auto k = std::min(static_cast<std::size_t>(at), anchors.size() - 2);
  const double part = at - static_cast<double>(k);
  Colour colour{};
  for (std::size_t c = 0; c < 3; ++c)
    colour[c] = static_cast<std::uint8_t>(std::lround((1 - part) * anchors[k][c] + part * anchors[k + 1][c]));
  return colour;
}

Scale scale_of(std::span<const std::span<const double>> maps, bool diverging) {
  std::vector<double> all;
  for (const auto map : maps)
    for (const double value : map)
      if (std::isfinite(value)) all.push_back(value);
  if (all.empty()) return {};
  std::sort(all.begin(), all.end());
  const auto quantile = [&](double q) {
    return all[static_cast<std::size_t>(q * static_cast<double>(all.size() - 1))];
  };
  Scale scale{quantile(0.005), quantile(0.995)};
  if (diverging) {
    scale.high = std::max(std::fabs(scale.low), std::fabs(scale.high));
    scale.low = -scale.high;
  }
  if (!(scale.high > scale.low)) scale.high = scale.low + 1;
  return scale;
}

std::string map_figure(const std::string& title, const std::string& caption, std::span<const double> values,
                       Shape shape, Scale scale, Palette palette, const std::string& unit, int side_px) {
  const int block = std::max(1, (std::max(shape.rows, shape.columns) + largest_side - 1) / largest_side);
  const Shape small{(shape.rows + block - 1) / block, (shape.columns + block - 1) / block};
  // Drawn in blocks, so that no viewer smooths it.
  const int grow = std::max(1, 200 / std::max(small.rows, small.columns));
  Canvas canvas({small.rows * grow, small.columns * grow}, nothing);
  for (int r = 0; r < small.rows; ++r)
    for (int c = 0; c < small.columns; ++c) {
      double sum = 0, count = 0;
      for (int v = r * block; v < std::min(shape.rows, (r + 1) * block); ++v)
        for (int u = c * block; u < std::min(shape.columns, (c + 1) * block); ++u) {
          const double value = values[static_cast<std::size_t>(v) * static_cast<std::size_t>(shape.columns) +
                                      static_cast<std::size_t>(u)];
          if (std::isfinite(value)) sum += value, count += 1;
        }
      if (count == 0) continue;
      const Colour colour = colour_of(palette, (sum / count - scale.low) / (scale.high - scale.low));
      for (int v = 0; v < grow; ++v)
        for (int u = 0; u < grow; ++u) canvas.set(r * grow + v, c * grow + u, colour);
    }
  Canvas bar({64, 1});
  for (int r = 0; r < 64; ++r) bar.set(r, 0, colour_of(palette, 1 - r / 63.0));
  const int longer = std::max(small.rows, small.columns);
  const int width = std::max(24, side_px * small.columns / longer),
            height = std::max(24, side_px * small.rows / longer);
  constexpr int heading = 20, bar_width = 9;
  const int numbers = 50 + 6 * static_cast<int>(unit.size());
  const int longest_title = 7 * static_cast<int>(title.size());
  std::string out =
      fmt::format("<figure><svg width=\"{}\" height=\"{}\" role=\"img\">\n",
                  std::max(width + 6 + bar_width + numbers, longest_title), heading + height + 2);
  const auto text = [&](int x, int y, int size, const std::string& words) {
    out += fmt::format("<text x=\"{}\" y=\"{}\" font-size=\"{}\" fill=\"#333\">{}</text>\n", x, y, size,
                       escaped(words));
  };
  text(0, 13, 13, title);
  out += image(canvas, 0, heading, width, height);
  out += image(bar, width + 6, heading, bar_width, height);
  text(width + 10 + bar_width, heading + 10, 11,
       short_number(scale.high, 3) + (unit.empty() ? "" : " " + unit));
  text(width + 10 + bar_width, heading + height - 1, 11, short_number(scale.low, 3));
  return out + "</svg>\n<figcaption>" + escaped(caption) + "</figcaption></figure>\n";
}

}  // namespace atomcam::report
