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
  // Rows are short: what every call sets up is loaded or added, not written word by word.
  const auto repeat = [&](const std::array<std::uint32_t, 4>& four)
                          HWY_ATTR { return hn::LoadDup128(d, four.data()); };
  alignas(16) static constexpr std::array<std::uint32_t, 4> multipliers{0xD2511F53u, 0, 0xCD9E8D57u, 0},
      key_steps{0x9E3779B9u, 0, 0xBB67AE85u, 0}, first_word{0xFFFFFFFFu, 0, 0, 0};
  alignas(16) const std::array<std::uint32_t, 4> first_key{key[0], 0, key[1], 0},
      first_counter{0, block, static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32)};
  const V multiplier = repeat(multipliers), key_step = repeat(key_steps);
  const V stride = hn::And(hn::Set(d, static_cast<std::uint32_t>(lanes / 4)), repeat(first_word));
  V counter = hn::Add(repeat(first_counter), hn::And(hn::ShiftRight<2>(hn::Iota(d, 0)), repeat(first_word)));
  V keys[10];
  keys[0] = repeat(first_key);
  for (int round = 1; round < 10; ++round) keys[round] = hn::Add(keys[round - 1], key_step);

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
      HWY_ALIGN std::uint32_t last[hn::MaxLanes(d)];
      hn::Store(a, d, last);
      for (std::size_t rest = 0; i + rest < count; ++rest) words[i + rest] = last[rest];
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
