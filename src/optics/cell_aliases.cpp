#include "optics/cell_aliases.hpp"

#include <string>

#include "base/error.hpp"

namespace atomcam {

CellAliases make_cell_aliases(std::span<const std::uint32_t> weights) {
  struct Entry {
    std::uint32_t index;
    std::uint64_t weight;
  };
  std::vector<Entry> entries;
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] > 0) entries.push_back({static_cast<std::uint32_t>(i), weights[i]});
    sum += weights[i];
  }
  if (sum != std::uint64_t{1} << 32)
    throw Error("cell weights", "weights sum to " + std::to_string(sum) + ", must be 2^32");

  CellAliases table;
  while (std::uint64_t{1} << (32 - table.low_bits) < entries.size()) --table.low_bits;
  const std::uint64_t capacity = std::uint64_t{1} << table.low_bits;
  const std::size_t slots = std::size_t{1} << (32 - table.low_bits);
  entries.resize(slots, Entry{entries.front().index, 0});  // empty slots, filled by their alias alone

  std::vector<std::size_t> small, large;
  for (std::size_t i = 0; i < slots; ++i) (entries[i].weight < capacity ? small : large).push_back(i);
  table.slots.reserve(slots);
  for (const Entry& entry : entries)
    table.slots.push_back({static_cast<std::uint32_t>(capacity), entry.index, entry.index});
  // A slot short of its capacity takes the rest from one that has more; sums are exact, so they come out
  // even.
  while (!small.empty()) {
    const std::size_t poor = small.back(), rich = large.back();
    small.pop_back();
    table.slots[poor].threshold = static_cast<std::uint32_t>(entries[poor].weight);
    table.slots[poor].alias = entries[rich].index;
    entries[rich].weight -= capacity - entries[poor].weight;
    if (entries[rich].weight < capacity) {
      large.pop_back();
      small.push_back(rich);
    }
  }
  return table;
}

}  // namespace atomcam
