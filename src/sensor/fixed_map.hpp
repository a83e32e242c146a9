#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

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
    constexpr float most = std::numeric_limits<Number>::max(), least = std::numeric_limits<Number>::min();
    float largest = 0;
    for (const float value : map.pixels()) largest = std::max(largest, std::fabs(value));
    while (largest / scale_ > most) scale_ *= 2;
    while (scale_ > 0x1p-24f && largest / (scale_ / 2) <= most) scale_ /= 2;
    const float per_value = 1 / scale_;
    for (std::size_t i = 0; i < numbers_.size(); ++i)
      numbers_[i] = static_cast<Number>(std::nearbyint(std::clamp(map.pixels()[i] * per_value, least, most)));
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
