#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/image.hpp"
#include "sensor/recent.hpp"
#include "sensor/uniform_poisson.hpp"

namespace atomcam {

/// Electrons of one frame that no atom sent: a uniform mean per pixel (dark, clock-induced charge) and stray
/// light, uniform or shaped by a map.
class Background {
 public:
  /// What a sensor keeps from frame to frame.
  struct Cache {
    Recent<double, UniformPoisson> laws{16};
    Recent<std::shared_ptr<const RatioMap>, double> largest_ratios{4};
  };

  /// Means per output pixel of `plane`. Streams "sensor/collect" and "sensor/thinning".
  Background(Cache& cache, Shape plane, double uniform_e, double light_e,
             std::shared_ptr<const RatioMap> ratio, std::uint64_t seed, std::uint64_t frame);

  /// Sets the row. A map thins the electrons of the largest mean: each is kept with the probability mean /
  /// largest, which leaves exactly Poisson numbers of each pixel's own mean.
  void fill(int row, std::span<std::int32_t> electrons) const;

 private:
  double uniform_e_, light_e_, largest_e_;
  std::shared_ptr<const RatioMap> ratio_;  // null: uniform
  std::shared_ptr<const UniformPoisson> law_;
  UniformPoisson::Keys keys_;
  PhiloxKey thinning_;
  std::uint64_t frame_;
};

}  // namespace atomcam
