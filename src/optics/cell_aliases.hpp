#pragma once
// Draws an index with probability weight / 2^32 from one 32-bit word: Walker's alias method (1977) in
// integers, exact.

#include <cstdint>
#include <span>
#include <vector>

namespace atomcam {

/// One slot for each value of the word's high bits: below `threshold` (in the low bits) `own`, else `alias`.
struct CellAlias {
  std::uint32_t threshold;
  std::uint32_t own;
  std::uint32_t alias;
};

/// 2^(32 - low_bits) slots for weights of sum 2^32; `own` and `alias` index `weights`.
struct CellAliases {
  int low_bits = 32;
  std::vector<CellAlias> slots;
};

CellAliases make_cell_aliases(std::span<const std::uint32_t> weights);

}  // namespace atomcam
