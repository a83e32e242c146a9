#pragma once
// A small drawing in colour: images, circles, labels.

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/image.hpp"

namespace atomcam {

using Colour = std::array<std::uint8_t, 3>;  // red, green, blue

class Canvas {
 public:
  explicit Canvas(Shape shape, Colour background = {24, 24, 28});
  Shape shape() const { return shape_; }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }  // three a pixel, row by row
  Colour at(int row, int column) const;

  /// A point outside is left out.
  void set(int row, int column, Colour colour);
  /// Grey, 0 to 1 (clipped), its top left corner at (row, column).
  void draw(const Image<float, unit::ratio>& grey, int row, int column);
  void circle(double row, double column, double radius, Colour colour);
  /// Capital letters, digits and some signs, 7 * size high, 6 * size apart; others become spaces.
  void text(int row, int column, std::string_view words, Colour colour, int size = 2);

 private:
  Shape shape_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace atomcam
