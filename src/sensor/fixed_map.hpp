#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/error.hpp"
#include "base/image.hpp"
#include "sensor/row_loops.hpp"

namespace atomcam {

/// A map in 16-bit fixed point, as the per-pixel loops read it: value = number * scale, the scale a power of
/// two just large enough for the largest value, so that the resolution is about 2^-15 of it.
template <class Number>
class FixedMap {
 public:
  FixedMap() = default;
  template <class MapImage>
  explicit FixedMap(const MapImage& map) : shape_(map.shape()), numbers_(map.pixels().size()) {
    constexpr std::int32_t most = std::numeric_limits<Number>::max(),
                           least = std::numeric_limits<Number>::min();
    const std::span<const float> values = map.pixels();
    // Integer operations on the numbers' bits: compilers vectorise these loops, and those with fmax or
    // nearbyint not.
    std::int32_t largest_bits = 0;
    for (const float value : values)
      largest_bits = std::max(largest_bits, std::bit_cast<std::int32_t>(value) & 0x7fffffff);
    const auto largest = std::bit_cast<float>(largest_bits);
    if (!(largest < 1e9f)) throw Error("map", "holds a value of 1e9 or more, or none at all");
    while (largest / scale_ > most) scale_ *= 2;
    while (scale_ > 0x1p-24f && largest / (scale_ / 2) <= most) scale_ /= 2;
    const float per_value = 1 / scale_;
    for (std::size_t i = 0; i < numbers_.size(); ++i) {
      // Added to 1.5 * 2^23 a number is rounded into the lower bits.
      const std::int32_t number = std::bit_cast<std::int32_t>(values[i] * per_value + 0x1.8p23f) - 0x4b400000;
      numbers_[i] = static_cast<Number>(std::max(number, least));
    }
  }

  Shape shape() const { return shape_; }
  /// The row from a column on.
  row_loops::FixedRow<Number> row(int r, int first_column) const {
    return {numbers_.data() + static_cast<std::size_t>(r) * static_cast<std::size_t>(shape_.columns) +
                static_cast<std::size_t>(first_column),
            scale_};
  }

 private:
  Shape shape_;
  float scale_ = 1;
  std::vector<Number> numbers_;
};

}  // namespace atomcam
