#pragma once
// Counter-based random streams. A stream is keyed by (seed, stream name) and addressed by (frame, block), so
// any part of any frame can be drawn in any order, on any thread, and adding or removing an effect leaves
// every other draw as it was. Generator: Philox4x32-10 (Salmon, Moraes, Dror, Shaw, SC11,
// doi:10.1145/2063384.2063405), own code.

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace atomcam {

/// Names a stream, e.g. stream_id("sensor/read_noise"); 64-bit FNV-1a of the name. `hash`: that of what comes
/// before it, if the name has several parts.
constexpr std::uint64_t stream_id(std::string_view name, std::uint64_t hash = 0xcbf29ce484222325u) {
  for (const char letter : name) {
    hash ^= static_cast<unsigned char>(letter);
    hash *= 0x100000001b3u;
  }
  return hash;
}

using PhiloxCounter = std::array<std::uint32_t, 4>;
using PhiloxKey = std::array<std::uint32_t, 2>;

/// One block of Philox4x32 with ten rounds: four independent 32-bit words.
constexpr PhiloxCounter philox4x32(PhiloxCounter counter, PhiloxKey key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = std::uint64_t{0xD2511F53u} * counter[0];
    const std::uint64_t product1 = std::uint64_t{0xCD9E8D57u} * counter[2];
    counter = {static_cast<std::uint32_t>(product1 >> 32) ^ counter[1] ^ key[0],
               static_cast<std::uint32_t>(product1),
               static_cast<std::uint32_t>(product0 >> 32) ^ counter[3] ^ key[1],
               static_cast<std::uint32_t>(product0)};
    key[0] += 0x9E3779B9u;
    key[1] += 0xBB67AE85u;
  }
  return counter;
}

/// The key of a stream: a Philox block of the stream's id under the seed, so that neighbouring seeds share
/// nothing.
PhiloxKey stream_key(std::uint64_t seed, std::uint64_t stream);

/// Uniform in the open interval (0, 1), 2^-32 apart: never 0, never 1.
constexpr double uniform(std::uint32_t word) {
  return (static_cast<double>(word) + 0.5) * 0x1p-32;
}

/// A sequence of 32-bit words at (key; frame, block): counter = {word / 4, block, frame low, frame high}.
class RandomStream {
 public:
  using result_type = std::uint32_t;
  RandomStream(PhiloxKey key, std::uint64_t frame, std::uint32_t block) : key_(key) {
    counter_ = {0, block, static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32)};
  }
  RandomStream(std::uint64_t seed, std::uint64_t stream, std::uint64_t frame, std::uint32_t block)
      : RandomStream(stream_key(seed, stream), frame, block) {}

  std::uint32_t operator()() {
    if (used_ == 4) {
      words_ = philox4x32(counter_, key_);
      ++counter_[0];
      used_ = 0;
    }
    return words_[used_++];
  }
  std::uint64_t next64() {
    const std::uint64_t high = (*this)();
    return high << 32 | (*this)();
  }
  /// Of one word.
  double uniform() { return atomcam::uniform((*this)()); }
  /// Uniform in the open interval (0, 1), 2^-52 apart: with one bit more, the largest value would round to 1.
  double uniform53() { return (static_cast<double>(next64() >> 12) + 0.5) * 0x1p-52; }

  static constexpr std::uint32_t min() { return 0; }
  static constexpr std::uint32_t max() { return 0xffffffffu; }

 private:
  PhiloxCounter counter_;
  PhiloxKey key_;
  PhiloxCounter words_{};
  unsigned used_ = 4;
};

/// Fills `words` with the words of (key; frame, block) from the first on: the same words RandomStream gives,
/// many at a time on the widest instruction set at hand.
void fill_random(PhiloxKey key, std::uint64_t frame, std::uint32_t block, std::span<std::uint32_t> words);

}  // namespace atomcam
