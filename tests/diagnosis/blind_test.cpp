// Sealed stacks: what is drawn for them.
#include "diagnosis/blind.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace atomcam {
namespace {

TEST(Blind, EffectsOfOneCameraAreOnIt) {
  for (const char* name : {"serial_cic", "frame_transfer_smear"}) {
    ASSERT_FALSE(find_effect(name)->qcmos) << name;
    BlindOptions options;
    options.effects = {name};
    options.none_share = options.pair_share = 0;
    for (std::uint64_t number = 0; number < 8; ++number) {
      const BlindStack stack = make_blind_stack(options, number);
      ASSERT_EQ(stack.effects.size(), 1u) << name << ", stack " << number;
      EXPECT_EQ(stack.effects.front().name, name);
      EXPECT_EQ(stack.lab.kind(), CameraKind::emccd);
    }
  }
}

TEST(Blind, SharesAreThoseAskedFor) {
  BlindOptions options;
  options.none_share = 0.3;
  options.pair_share = 0.4;
  int none = 0, pairs = 0;
  constexpr int stacks = 400;
  for (std::uint64_t number = 0; number < stacks; ++number) {
    const std::size_t count = make_blind_stack(options, number).effects.size();
    none += count == 0;
    pairs += count == 2;
  }
  // Five standard deviations.
  EXPECT_NEAR(none, 0.3 * stacks, 5 * std::sqrt(stacks * 0.3 * 0.7));
  EXPECT_NEAR(pairs, 0.4 * stacks, 5 * std::sqrt(stacks * 0.4 * 0.6));
}

}  // namespace
}  // namespace atomcam
