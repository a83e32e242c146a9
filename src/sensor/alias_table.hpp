#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace atomcam {

/// A law on consecutive integers, drawn with one 32-bit word (Walker's alias method on integers). The
/// cumulative law is rounded to multiples of 2^-32 and then drawn exactly, so tails are right down to about
/// 1e-9.
class AliasTable {
 public:
  AliasTable() = default;
  /// `cumulative[i]`: probability of a value <= first + i, non-decreasing; the last is taken as 1.
  AliasTable(std::span<const double> cumulative, std::int64_t first);

  std::int32_t draw(std::uint32_t word) const {
    const std::uint32_t index = word >> shift_;
    const Cell cell = cells_[index];
    // Chosen by masking: nobody can predict this branch.
    const std::int32_t own = first_ + static_cast<std::int32_t>(index);
    const auto keep = -static_cast<std::int32_t>((word & mask_) < cell.cut);
    return cell.alias ^ ((cell.alias ^ own) & keep);
  }
  std::size_t size() const { return cells_.size(); }

 private:
  struct Cell {
    std::uint32_t cut = 0;   // words below keep the cell's own value
    std::int32_t alias = 0;  // the others give this one
  };
  std::vector<Cell> cells_;
  std::int32_t first_ = 0;
  unsigned shift_ = 31;
  std::uint32_t mask_ = 0;
};

}  // namespace atomcam
