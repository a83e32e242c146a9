#include "optics/cell_aliases.hpp"

#include <gtest/gtest.h>

#include <numeric>

#include "base/error.hpp"
#include "base/random.hpp"

namespace atomcam {
namespace {

std::vector<std::uint64_t> words_of(const CellAliases& table, std::size_t indices) {
  std::vector<std::uint64_t> words(indices);
  const std::uint64_t capacity = std::uint64_t{1} << table.low_bits;
  for (const CellAlias& slot : table.slots) {
    words[slot.own] += slot.threshold;
    words[slot.alias] += capacity - slot.threshold;
  }
  return words;
}

TEST(CellAliases, GivesEachIndexAsManyWordsAsItsWeight) {
  for (const std::size_t count : {2u, 3u, 1000u, 1024u, 1025u, 60000u}) {
    std::vector<std::uint32_t> weights(count);
    RandomStream random(1, stream_id("test/alias"), 0, static_cast<std::uint32_t>(count));
    std::uint64_t left = std::uint64_t{1} << 32;
    for (std::size_t i = 1; i < count; ++i) {
      weights[i] = i % 5 == 0 ? 0 : static_cast<std::uint32_t>(random() % (left / (count - i + 1)));
      left -= weights[i];
    }
    weights[0] = static_cast<std::uint32_t>(left);
    const auto words = words_of(make_cell_aliases(weights), count);
    for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(words[i], weights[i]);
  }
}

TEST(CellAliases, RefusesAnotherSum) {
  const std::vector<std::uint32_t> weights{1, 2, 3};
  EXPECT_THROW(make_cell_aliases(weights), Error);
}

}  // namespace
}  // namespace atomcam
