#pragma once
// Big-endian fields in packets. Readers take spans that the caller has checked to be long enough.

#include <cassert>
#include <cstdint>
#include <span>
#include <vector>

namespace atomcam::gige {

using Bytes = std::span<const std::uint8_t>;

inline std::uint16_t load16(Bytes bytes, std::size_t at) {
  assert(at + 2 <= bytes.size());
  return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}
inline std::uint32_t load32(Bytes bytes, std::size_t at) {
  assert(at + 4 <= bytes.size());
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
}
inline std::uint64_t load64(Bytes bytes, std::size_t at) {
  return std::uint64_t{load32(bytes, at)} << 32 | load32(bytes, at + 4);
}

inline void store16(std::uint8_t* out, std::uint32_t value) {
  out[0] = static_cast<std::uint8_t>(value >> 8);
  out[1] = static_cast<std::uint8_t>(value);
}
inline void store32(std::uint8_t* out, std::uint32_t value) {
  store16(out, value >> 16);
  store16(out + 2, value & 0xffff);
}
inline void store64(std::uint8_t* out, std::uint64_t value) {
  store32(out, static_cast<std::uint32_t>(value >> 32));
  store32(out + 4, static_cast<std::uint32_t>(value));
}

inline void append16(std::vector<std::uint8_t>& out, std::uint32_t value) {
  out.push_back(static_cast<std::uint8_t>(value >> 8));
  out.push_back(static_cast<std::uint8_t>(value));
}
inline void append32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  append16(out, value >> 16);
  append16(out, value & 0xffff);
}
inline void append64(std::vector<std::uint8_t>& out, std::uint64_t value) {
  append32(out, static_cast<std::uint32_t>(value >> 32));
  append32(out, static_cast<std::uint32_t>(value));
}

}  // namespace atomcam::gige
