#pragma once
// A chart as SVG, to stand in a page.

#include <string>
#include <vector>

namespace atomcam::report {

inline constexpr const char* ink = "#1b1b1b";
inline constexpr const char* orange = "#c8641e";
inline constexpr const char* blue = "#2a6f9e";
inline constexpr const char* green = "#3d7d4a";
inline constexpr const char* grey = "#999999";

struct Line {
  std::string label;  // empty: not in the legend
  std::string colour = ink;
  std::vector<double> x, y;  // a value that is not finite interrupts the line
  double width = 1.4;
  bool dashed = false;
  bool points = false;        // dots instead of a line
  std::vector<double> error;  // of the points; may be empty
};

struct Band {
  std::string label, colour;
  std::vector<double> x, low, high;
};

struct Chart {
  std::string title, x_label, y_label;
  bool log_y = false;
  bool from_zero = false;  // the axis of y holds 0
  std::vector<Band> bands;
  std::vector<Line> lines;
  int width = 500, height = 260;
};

std::string svg(const Chart& chart);

struct Bar {
  std::string label;
  double value = 0, error = 0;
};
/// Bars side by side with their errors.
std::string bars_svg(const std::string& title, const std::string& y_label, const std::vector<Bar>& bars,
                     int width = 680, int height = 260);

}  // namespace atomcam::report
