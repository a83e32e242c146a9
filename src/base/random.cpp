// The bulk generator, compiled once per instruction set by the include below.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/random.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "base/random.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::HWY_NAMESPACE {

#if HWY_TARGET == HWY_SCALAR

void fill_philox(PhiloxKey key, std::uint64_t frame, std::uint32_t block, std::uint32_t* words,
                 std::size_t count) {
  RandomStream stream(key, frame, block);
  for (std::size_t i = 0; i < count; ++i) words[i] = stream();
}

#else

namespace hn = hwy::HWY_NAMESPACE;

/// A 128-bit lane holds one block's counter, whose words 0 and 2 are
/// where the instruction that multiplies every other 32-bit word wants them. Four operations a round; their
/// order of words is that of the stream, so nothing is rearranged afterwards.
void fill_philox(PhiloxKey key, std::uint64_t frame, std::uint32_t block, std::uint32_t* HWY_RESTRICT words,
                 std::size_t count) {
  const hn::ScalableTag<std::uint32_t> d;
  using V = hn::Vec<decltype(d)>;
  const std::size_t lanes = hn::Lanes(d);
  const auto step = static_cast<std::uint32_t>(lanes / 4);

  HWY_ALIGN std::uint32_t pattern[hn::MaxLanes(d)];
  const auto repeat = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t e) {
    for (std::size_t i = 0; i < lanes; i += 4) {
      pattern[i] = a;
      pattern[i + 1] = b;
      pattern[i + 2] = c;
      pattern[i + 3] = e;
    }
    return hn::Load(d, pattern);
  };
  const V multiplier = repeat(0xD2511F53u, 0, 0xCD9E8D57u, 0);
  const V stride = repeat(step, 0, 0, 0);
  repeat(0, block, static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32));
  for (std::size_t i = 0; i < lanes; i += 4) pattern[i] += static_cast<std::uint32_t>(i / 4);
  V counter = hn::Load(d, pattern);
  V keys[10];
  for (std::uint32_t round = 0; round < 10; ++round)
    keys[round] = repeat(key[0] + round * 0x9E3779B9u, 0, key[1] + round * 0xBB67AE85u, 0);

  const hn::Repartition<std::uint64_t, decltype(d)> d64;
  const auto next_round = [&](V state, V round_key) HWY_ATTR {
    const V product = hn::BitCast(d, hn::MulEven(state, multiplier));
    const V odd = hn::BitCast(d, hn::ShiftRight<32>(hn::BitCast(d64, state)));
    return hn::Xor3(hn::Shuffle0123(product), odd, round_key);
  };
  std::size_t i = 0;
  for (; i + 4 * lanes <= count; i += 4 * lanes) {
    V a = counter, b = hn::Add(a, stride), c = hn::Add(b, stride), e = hn::Add(c, stride);
    counter = hn::Add(e, stride);
    for (const V& round_key : keys) {
      a = next_round(a, round_key);
      b = next_round(b, round_key);
      c = next_round(c, round_key);
      e = next_round(e, round_key);
    }
    hn::StoreU(a, d, words + i);
    hn::StoreU(b, d, words + i + lanes);
    hn::StoreU(c, d, words + i + 2 * lanes);
    hn::StoreU(e, d, words + i + 3 * lanes);
  }
  for (; i < count; i += lanes) {
    V a = counter;
    counter = hn::Add(counter, stride);
    for (const V& round_key : keys) a = next_round(a, round_key);
    if (i + lanes <= count) {
      hn::StoreU(a, d, words + i);
    } else {
      hn::Store(a, d, pattern);
      for (std::size_t rest = 0; i + rest < count; ++rest) words[i + rest] = pattern[rest];
    }
  }
}

#endif

}  // namespace atomcam::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam {

HWY_EXPORT(fill_philox);

PhiloxKey stream_key(std::uint64_t seed, std::uint64_t stream) {
  const PhiloxCounter block = philox4x32(
      {static_cast<std::uint32_t>(stream), static_cast<std::uint32_t>(stream >> 32), 0x61746f6du, 0},
      {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)});
  return {block[0], block[1]};
}

void fill_random(PhiloxKey key, std::uint64_t frame, std::uint32_t block, std::span<std::uint32_t> words) {
  HWY_DYNAMIC_DISPATCH(fill_philox)(key, frame, block, words.data(), words.size());
}

}  // namespace atomcam
#endif  // HWY_ONCE
