#pragma once
// Images and the planes they live on. Arrays are [row, column], row-major, origin top left, pixel centres at
// integers. An image of photons is not an image of electrons: the unit is part of the type.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace atomcam {

struct Shape {
  int rows = 0;
  int columns = 0;
  std::size_t pixels() const { return static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns); }
  bool operator==(const Shape&) const = default;
};

template <class Value, class Unit>
class Image {
 public:
  Image() = default;
  explicit Image(Shape shape, Value value = Value{}) : shape_(shape), pixels_(shape.pixels(), value) {}

  Shape shape() const { return shape_; }
  int rows() const { return shape_.rows; }
  int columns() const { return shape_.columns; }
  bool empty() const { return pixels_.empty(); }

  std::span<Value> row(int r) { return std::span(pixels_).subspan(index(r, 0), shape_.columns); }
  std::span<const Value> row(int r) const { return std::span(pixels_).subspan(index(r, 0), shape_.columns); }
  Value& operator()(int r, int c) { return pixels_[index(r, c)]; }
  const Value& operator()(int r, int c) const { return pixels_[index(r, c)]; }
  std::span<Value> pixels() { return pixels_; }
  std::span<const Value> pixels() const { return pixels_; }

  bool operator==(const Image&) const = default;

 private:
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(shape_.columns) +
           static_cast<std::size_t>(c);
  }

  Shape shape_;
  std::vector<Value> pixels_;
};

namespace unit {
struct photons;             // expected photons that reach a pixel
struct ratio;               // dimensionless map (transmission, relative response)
struct electrons;           // electrons in a pixel, before the register
struct register_electrons;  // electrons at the end of the EM register
struct counts;              // digital numbers out of the converter
}  // namespace unit

using PhotonImage = Image<float, unit::photons>;
using RatioMap = Image<float, unit::ratio>;
using ElectronImage = Image<std::int32_t, unit::electrons>;
using RegisterImage = Image<float, unit::register_electrons>;
using CountImage = Image<std::uint16_t, unit::counts>;

}  // namespace atomcam
