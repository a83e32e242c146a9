#include "base/random.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace atomcam {
namespace {

TEST(Philox, KnownAnswers) {
  // Known-answer vectors of the generator's paper (ten rounds).
  EXPECT_EQ(philox4x32({0, 0, 0, 0}, {0, 0}),
            (PhiloxCounter{0x6627e8d5u, 0xe169c58du, 0xbc57ac4cu, 0x9b00dbd8u}));
  EXPECT_EQ(philox4x32({0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu}, {0xffffffffu, 0xffffffffu}),
            (PhiloxCounter{0x408f276du, 0x41c83b0eu, 0xa20bc7c6u, 0x6d5451fdu}));
  EXPECT_EQ(philox4x32({0x243f6a88u, 0x85a308d3u, 0x13198a2eu, 0x03707344u}, {0xa4093822u, 0x299f31d0u}),
            (PhiloxCounter{0xd16cfe09u, 0x94fdccebu, 0x5001e420u, 0x24126ea1u}));
}

TEST(Philox, BulkGivesTheWordsOfTheStream) {
  std::vector<std::uint32_t> words(1003);
  const PhiloxKey key = stream_key(7, stream_id("test"));
  fill_random(key, 5, 9, words);
  RandomStream stream(7, stream_id("test"), 5, 9);
  for (const std::uint32_t word : words) EXPECT_EQ(word, stream());
}

}  // namespace
}  // namespace atomcam
