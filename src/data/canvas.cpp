#include "data/canvas.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>

namespace atomcam {
namespace {

struct Glyph {
  char letter;
  std::array<std::uint8_t, 7> rows;  // five bits each, the leftmost the highest
};
constexpr Glyph glyphs[] = {
    {'%', {0b11001, 0b11001, 0b00010, 0b00100, 0b01000, 0b10011, 0b10011}},
    {'(', {0b00010, 0b00100, 0b01000, 0b01000, 0b01000, 0b00100, 0b00010}},
    {')', {0b01000, 0b00100, 0b00010, 0b00010, 0b00010, 0b00100, 0b01000}},
    {'+', {0b00000, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0b00000}},
    {',', {0b00000, 0b00000, 0b00000, 0b00000, 0b01100, 0b00100, 0b01000}},
    {'-', {0b00000, 0b00000, 0b00000, 0b01110, 0b00000, 0b00000, 0b00000}},
    {'.', {0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b01100, 0b01100}},
    {'/', {0b00001, 0b00010, 0b00010, 0b00100, 0b01000, 0b01000, 0b10000}},
    {'0', {0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110}},
    {'1', {0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110}},
    {'2', {0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111}},
    {'3', {0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110}},
    {'4', {0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010}},
    {'5', {0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110}},
    {'6', {0b01110, 0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110}},
    {'7', {0b11111, 0b00001, 0b00010, 0b00100, 0b00100, 0b01000, 0b01000}},
    {'8', {0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110}},
    {'9', {0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00001, 0b01110}},
    {':', {0b00000, 0b01100, 0b01100, 0b00000, 0b01100, 0b01100, 0b00000}},
    {'=', {0b00000, 0b00000, 0b11111, 0b00000, 0b11111, 0b00000, 0b00000}},
    {'A', {0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001}},
    {'B', {0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110}},
    {'C', {0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110}},
    {'D', {0b11110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b11110}},
    {'E', {0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111}},
    {'F', {0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000}},
    {'G', {0b01110, 0b10001, 0b10000, 0b10111, 0b10001, 0b10001, 0b01110}},
    {'H', {0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001}},
    {'I', {0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110}},
    {'J', {0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100}},
    {'K', {0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001}},
    {'L', {0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111}},
    {'M', {0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001}},
    {'N', {0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001}},
    {'O', {0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110}},
    {'P', {0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000}},
    {'Q', {0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101}},
    {'R', {0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001}},
    {'S', {0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110}},
    {'T', {0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100}},
    {'U', {0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110}},
    {'V', {0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b01010, 0b00100}},
    {'W', {0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001}},
    {'X', {0b10001, 0b01010, 0b01010, 0b00100, 0b01010, 0b01010, 0b10001}},
    {'Y', {0b10001, 0b01010, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100}},
    {'Z', {0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111}},
};

}  // namespace

Canvas::Canvas(Shape shape, Colour background) : shape_(shape) {
  bytes_.reserve(3 * shape.pixels());
  for (std::size_t i = 0; i < shape.pixels(); ++i)
    bytes_.insert(bytes_.end(), background.begin(), background.end());
}

Colour Canvas::at(int row, int column) const {
  const std::size_t i = 3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(shape_.columns) +
                             static_cast<std::size_t>(column));
  return {bytes_[i], bytes_[i + 1], bytes_[i + 2]};
}

void Canvas::set(int row, int column, Colour colour) {
  if (row < 0 || row >= shape_.rows || column < 0 || column >= shape_.columns) return;
  const std::size_t i = 3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(shape_.columns) +
                             static_cast<std::size_t>(column));
  std::ranges::copy(colour, bytes_.begin() + static_cast<std::ptrdiff_t>(i));
}

void Canvas::draw(const Image<float, unit::ratio>& grey, int row, int column) {
  for (int r = 0; r < grey.rows(); ++r) {
    for (int c = 0; c < grey.columns(); ++c) {
      const auto level = static_cast<std::uint8_t>(std::clamp(grey(r, c), 0.f, 1.f) * 255 + 0.5f);
      set(row + r, column + c, {level, level, level});
    }
  }
}

void Canvas::circle(double row, double column, double radius, Colour colour) {
  const int steps = std::max(8, static_cast<int>(12 * radius));
  for (int i = 0; i < steps; ++i) {
    const double angle = 2 * 3.14159265358979 * i / steps;
    set(static_cast<int>(std::lround(row + radius * std::sin(angle))),
        static_cast<int>(std::lround(column + radius * std::cos(angle))), colour);
  }
}

void Canvas::text(int row, int column, std::string_view words, Colour colour, int size) {
  for (const char word_letter : words) {
    const char letter = static_cast<char>(std::toupper(static_cast<unsigned char>(word_letter)));
    const auto* glyph = std::ranges::find(glyphs, letter, &Glyph::letter);
    for (int r = 0; glyph != std::end(glyphs) && r < 7 * size; ++r) {
      for (int c = 0; c < 5 * size; ++c)
        if (glyph->rows[static_cast<std::size_t>(r / size)] >> (4 - c / size) & 1)
          set(row + r, column + c, colour);
    }
    column += 6 * size;
  }
}

}  // namespace atomcam
