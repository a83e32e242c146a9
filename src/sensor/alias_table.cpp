#include "sensor/alias_table.hpp"

#include <bit>

namespace atomcam {

AliasTable::AliasTable(std::span<const double> cumulative, std::int64_t first) {
  std::vector<std::uint64_t> weights(cumulative.size());
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    auto upto = i + 1 == weights.size() ? std::uint64_t{1} << 32
                                        : static_cast<std::uint64_t>(cumulative[i] * 0x1p32 + 0.5);
    if (upto > std::uint64_t{1} << 32) upto = std::uint64_t{1} << 32;
    if (upto < below) upto = below;
    weights[i] = upto - below;
    below = upto;
  }
  // Values that no word can give would only spread the table over more cache lines.
  std::size_t begin = 0, end = weights.size();
  while (begin + 1 < end && weights[begin] == 0) ++begin;
  while (end > begin + 1 && weights[end - 1] == 0) --end;
  first_ = static_cast<std::int32_t>(first + static_cast<std::int64_t>(begin));
  const std::size_t values = end - begin;
  const unsigned bits = values <= 2 ? 1 : static_cast<unsigned>(std::bit_width(values - 1));
  shift_ = 32 - bits;
  mask_ = (std::uint32_t{1} << shift_) - 1;
  const std::uint64_t share = std::uint64_t{1} << shift_;  // words per cell

  std::vector<std::uint64_t> left(std::size_t{1} << bits, 0);
  for (std::size_t i = 0; i < values; ++i) left[i] = weights[begin + i];
  cells_.resize(left.size());
  std::vector<std::uint32_t> poor, rich;
  for (std::uint32_t i = 0; i < left.size(); ++i) (left[i] < share ? poor : rich).push_back(i);
  while (!poor.empty()) {
    const std::uint32_t i = poor.back();
    poor.pop_back();
    const std::uint32_t giver =
        rich.back();  // the weights sum to cells * share, so a poor cell leaves a rich one
    cells_[i] = {static_cast<std::uint32_t>(left[i]), first_ + static_cast<std::int32_t>(giver)};
    left[giver] -= share - left[i];
    if (left[giver] < share) {
      rich.pop_back();
      poor.push_back(giver);
    }
  }
  for (const std::uint32_t i : rich)  // exactly full
    cells_[i] = {static_cast<std::uint32_t>(share), first_ + static_cast<std::int32_t>(i)};
}

}  // namespace atomcam
