#pragma once
// Numbers in registers and chunks are big endian; floating-point numbers are IEEE 754.

#include <bit>
#include <cstdint>
#include <type_traits>

namespace atomcam {

template <class Value>
void store_big_endian(Value value, std::uint8_t* bytes) {
  using Bits = std::conditional_t<sizeof(Value) == 8, std::uint64_t, std::uint32_t>;
  auto bits = std::bit_cast<Bits>(value);
  for (int i = static_cast<int>(sizeof(Value)) - 1; i >= 0; --i, bits >>= 8)
    bytes[i] = static_cast<std::uint8_t>(bits);
}

template <class Value>
Value load_big_endian(const std::uint8_t* bytes) {
  using Bits = std::conditional_t<sizeof(Value) == 8, std::uint64_t, std::uint32_t>;
  Bits bits = 0;
  for (std::size_t i = 0; i < sizeof(Value); ++i) bits = bits << 8 | bytes[i];
  return std::bit_cast<Value>(bits);
}

}  // namespace atomcam
