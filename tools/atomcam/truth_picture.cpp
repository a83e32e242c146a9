#include "atomcam/truth_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace atomcam {
namespace {

constexpr int panel_px = 800;  // about the side of a panel
constexpr int margin = 16, heading = 72, footing = 40;
constexpr Colour white = {235, 235, 235}, grey = {120, 120, 130}, green = {80, 230, 110},
                 orange = {255, 160, 40};

/// Output pixels to show, and how they become pixels of the picture.
struct View {
  int row = 0, column = 0, rows = 0, columns = 0;
  int grow = 1, shrink = 1;
  double scale() const { return static_cast<double>(grow) / shrink; }
  Shape shape() const { return {rows * grow / shrink, columns * grow / shrink}; }
};

struct Point {
  double row, column;
};

Point on_output(double x_px, double y_px, const StackSettings& settings) {
  return {(y_px + 0.5 - settings.offset_y) / settings.binning_y - 0.5,
          (x_px + 0.5 - settings.offset_x) / settings.binning_x - 0.5};
}

View view_of(const Lab& lab, const StackSettings& settings, Shape shape) {
  double top = shape.rows, left = shape.columns, bottom = 0, right = 0;
  for (const Site& site : lab.scene.sites) {
    const Point at = on_output(site.x_px, site.y_px, settings);
    top = std::min(top, at.row), bottom = std::max(bottom, at.row);
    left = std::min(left, at.column), right = std::max(right, at.column);
  }
  const double border = 8 + 0.04 * std::max(bottom - top, right - left);
  View view;
  view.row = std::clamp(static_cast<int>(top - border), 0, shape.rows - 1);
  view.column = std::clamp(static_cast<int>(left - border), 0, shape.columns - 1);
  view.rows = std::clamp(static_cast<int>(bottom + border) - view.row, 1, shape.rows - view.row);
  view.columns = std::clamp(static_cast<int>(right + border) - view.column, 1, shape.columns - view.column);
  const int side = std::max(view.rows, view.columns);
  view.grow = std::clamp(panel_px / side, 1, 8);
  view.shrink = std::max(1, (side + panel_px - 1) / panel_px);
  if (view.shrink > 1) view.grow = 1;
  return view;
}

/// Counts between the darkest and the brightest few in a thousand, as grey.
Image<float, unit::ratio> panel(const CountImage& counts, const View& view, double& black,
                                double& white_counts) {
  const Shape shape = view.shape();
  Image<float, unit::ratio> image(shape);
  for (int r = 0; r < shape.rows; ++r) {
    for (int c = 0; c < shape.columns; ++c) {
      double sum = 0;
      for (int i = 0; i < view.shrink; ++i)
        for (int j = 0; j < view.shrink; ++j)
          sum += counts(view.row + r * view.shrink / view.grow + i,
                        view.column + c * view.shrink / view.grow + j);
      image(r, c) = static_cast<float>(sum / (view.shrink * view.shrink));
    }
  }
  std::vector<float> sorted(image.pixels().begin(), image.pixels().end());
  std::ranges::sort(sorted);
  black = sorted[sorted.size() / 20];
  white_counts = sorted[sorted.size() - 1 - sorted.size() / 1000];
  const double span = std::max(1.0, white_counts - black);
  for (float& pixel : image.pixels()) pixel = static_cast<float>((pixel - black) / span);
  return image;
}

}  // namespace

Canvas truth_picture(const CountImage& counts, const FrameAtoms& truth, const Lab& lab,
                     const StackSettings& settings) {
  const View view = view_of(lab, settings, counts.shape());
  double black = 0, bright = 0;
  const Image<float, unit::ratio> image = panel(counts, view, black, bright);
  const int second = 2 * margin + image.columns();
  Canvas canvas({heading + image.rows() + footing, second + image.columns() + margin});
  canvas.text(margin, margin, fmt::format("{}  frame {}", settings.camera, truth.frame), white);
  canvas.text(margin + 26, margin,
              fmt::format("image: {:.0f} (black) to {:.0f} counts (white)", black, bright), grey);
  canvas.text(margin + 26, second, "ground truth of the same frame", grey);
  canvas.draw(image, heading, margin);

  Image<float, unit::ratio> dark(image.shape());
  canvas.draw(dark, heading, second);
  const auto place = [&](double x_px, double y_px) {
    const Point at = on_output(x_px, y_px, settings);
    return Point{heading + (at.row + 0.5 - view.row) * view.scale() - 0.5,
                 second + (at.column + 0.5 - view.column) * view.scale() - 0.5};
  };
  const double radius = std::max(4.0, 2.5 * view.scale());
  for (const Site& site : lab.scene.sites) {
    const Point at = place(site.x_px, site.y_px);
    canvas.set(static_cast<int>(std::lround(at.row)), static_cast<int>(std::lround(at.column)), grey);
  }
  std::size_t lost = 0;
  for (const FrameAtoms::Atom& atom : truth.atoms) {
    const Point at = place(atom.x_px, atom.y_px);
    const Colour colour = atom.lost ? orange : green;
    lost += atom.lost ? 1 : 0;
    for (double r = 0; r <= radius; r += 0.5) canvas.circle(at.row, at.column, r, colour);
  }
  const int bottom = heading + image.rows() + 14;
  canvas.text(bottom, margin, fmt::format("{} sites, {} atoms", lab.scene.sites.size(), truth.atoms.size()),
              white);
  const std::string stay = fmt::format("{} stay", truth.atoms.size() - lost);
  const std::string leave = fmt::format("{} lost in the exposure", lost);
  canvas.text(bottom, second, stay, green);
  canvas.text(bottom, second + 12 * static_cast<int>(stay.size() + 2), leave, orange);
  canvas.text(bottom, second + 12 * static_cast<int>(stay.size() + leave.size() + 4), ". empty site", grey);
  return canvas;
}

}  // namespace atomcam
