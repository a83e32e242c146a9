#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/image.hpp"
#include "base/random.hpp"

namespace atomcam {

/// Dark electrons of pixels with individual rates. Few per row: their number is drawn for the row and each is
/// placed by the row's sums over blocks of pixels; many: a Poisson number per pixel. Which of the two depends
/// on the mean only.
class DarkMap {
 public:
  explicit DarkMap(std::shared_ptr<const RatioMap> ratio);

  /// Adds the electrons of sensor row `row`, columns `first_column` on, of mean `mean_e` times the map's
  /// ratio.
  void add(RandomStream random, int row, int first_column, double mean_e,
           std::span<std::int32_t> electrons) const;
  const RatioMap& ratio() const { return *ratio_; }

 private:
  static constexpr int block_ = 16;
  double sum_before(int row, int column) const;

  std::shared_ptr<const RatioMap> ratio_;
  int blocks_ = 0;            // per row
  std::vector<double> sums_;  // per row: sums over the pixels before block 0, 1, ..., blocks_
};

}  // namespace atomcam
