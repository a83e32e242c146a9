#pragma once
// A frame in single precision with zeros around it, so that sums over pixel pairs need no edges: one flat
// loop per frame.

#include <cstddef>
#include <cstring>
#include <new>
#include <vector>

#include "base/image.hpp"

namespace atomcam::analysis {

template <class Value>
struct CacheAligned {
  using value_type = Value;
  CacheAligned() = default;
  template <class Other>
  CacheAligned(const CacheAligned<Other>&) {}
  Value* allocate(std::size_t n) {
    return static_cast<Value*>(::operator new (n * sizeof(Value), std::align_val_t{64}));
  }
  void deallocate(Value* p, std::size_t) { ::operator delete (p, std::align_val_t{64}); }
  template <class Other>
  bool operator==(const CacheAligned<Other>&) const {
    return true;
  }
};

using Floats = std::vector<float, CacheAligned<float>>;

/// Place of pixels in a flat array: `margin_rows` rows of zeros above and below, at least `margin_columns`
/// zeros behind every row, which are also those in front of the next.
struct PlaneShape {
  static constexpr int margin_rows = 5;
  static constexpr int margin_columns = 8;
  static constexpr int lanes = 16;

  int rows = 0, columns = 0;
  std::ptrdiff_t stride = 0;

  PlaneShape() = default;
  explicit PlaneShape(Shape shape)
      : rows(shape.rows),
        columns(shape.columns),
        stride((shape.columns + margin_columns + lanes - 1) / lanes * lanes) {}
  std::size_t size() const { return static_cast<std::size_t>(stride * (rows + 2 * margin_rows)); }
  std::size_t index(int row, int column) const {
    return static_cast<std::size_t>(stride * (row + margin_rows) + column);
  }
  /// The part between the margins: whole rows, a multiple of the lanes.
  std::size_t begin() const { return index(0, 0); }
  std::size_t inner() const { return static_cast<std::size_t>(stride * rows); }
  std::size_t pixels() const { return static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns); }
};

class Plane {
 public:
  Plane() = default;
  explicit Plane(PlaneShape shape) : shape_(shape), values_(shape.size()) {}
  const PlaneShape& shape() const { return shape_; }
  float* row(int r) { return values_.data() + shape_.index(r, 0); }
  const float* row(int r) const { return values_.data() + shape_.index(r, 0); }
  float& at(int r, int c) { return values_[shape_.index(r, c)]; }
  float at(int r, int c) const { return values_[shape_.index(r, c)]; }
  float* inner() { return values_.data() + shape_.begin(); }
  const float* inner() const { return values_.data() + shape_.begin(); }
  std::size_t size() const { return shape_.inner(); }
  float* all() { return values_.data(); }
  const float* all() const { return values_.data(); }

 private:
  PlaneShape shape_;
  Floats values_;
};

}  // namespace atomcam::analysis
