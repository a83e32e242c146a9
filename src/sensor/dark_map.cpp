#include "sensor/dark_map.hpp"

#include <algorithm>

#include "base/samplers.hpp"

namespace atomcam {

DarkMap::DarkMap(std::shared_ptr<const RatioMap> ratio) : ratio_(std::move(ratio)) {
  const Shape shape = ratio_->shape();
  blocks_ = (shape.columns + block_ - 1) / block_;
  sums_.reserve(static_cast<std::size_t>(shape.rows) * static_cast<std::size_t>(blocks_ + 1));
  for (int r = 0; r < shape.rows; ++r) {
    const std::span<const float> row = ratio_->row(r);
    double sum = 0;
    for (int c = 0; c < shape.columns; ++c) {
      if (c % block_ == 0) sums_.push_back(sum);
      sum += row[static_cast<std::size_t>(c)];
    }
    sums_.push_back(sum);
  }
}

double DarkMap::sum_before(int row, int column) const {
  const int block = column / block_;
  double sum = sums_[static_cast<std::size_t>(row) * static_cast<std::size_t>(blocks_ + 1) +
                     static_cast<std::size_t>(block)];
  const std::span<const float> ratio = ratio_->row(row);
  for (int c = block * block_; c < column; ++c) sum += ratio[static_cast<std::size_t>(c)];
  return sum;
}

void DarkMap::add(RandomStream random, int row, int first_column, double mean_e,
                  std::span<std::int32_t> electrons) const {
  if (!(mean_e > 0)) return;
  const std::span<const float> ratio = ratio_->row(row);
  if (mean_e > 1) {
    for (std::size_t c = 0; c < electrons.size(); ++c)
      electrons[c] += static_cast<std::int32_t>(
          sample_poisson(random, mean_e * ratio[static_cast<std::size_t>(first_column) + c]));
    return;
  }
  const int end_column = first_column + static_cast<int>(electrons.size());
  const double from = sum_before(row, first_column), upto = sum_before(row, end_column);
  const std::int64_t count = sample_poisson(random, mean_e * (upto - from));
  const auto row_sums = sums_.begin() + static_cast<std::ptrdiff_t>(row) * (blocks_ + 1);
  for (std::int64_t i = 0; i < count; ++i) {
    const double target = from + random.uniform53() * (upto - from);
    int column =
        static_cast<int>(std::upper_bound(row_sums, row_sums + blocks_ + 1, target) - row_sums - 1) * block_;
    double sum = row_sums[column / block_];
    while (column < end_column - 1 && (sum += ratio[static_cast<std::size_t>(column)]) <= target) ++column;
    ++electrons[static_cast<std::size_t>(std::clamp(column, first_column, end_column - 1) - first_column)];
  }
}

}  // namespace atomcam
