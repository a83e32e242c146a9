#include "base/random.hpp"

namespace atomcam {

PhiloxKey stream_key(std::uint64_t seed, std::uint64_t stream) {
  const PhiloxCounter block =
      philox4x32({static_cast<std::uint32_t>(stream), static_cast<std::uint32_t>(stream >> 32), 0x61746f6du, 0},
                 {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)});
  return {block[0], block[1]};
}

void fill_random(PhiloxKey key, std::uint64_t frame, std::uint32_t block, std::span<std::uint32_t> words) {
  RandomStream stream(key, frame, block);
  for (std::uint32_t& word : words) word = stream();
}

}  // namespace atomcam
