#pragma once
// Pixel formats a camera sends. Converters give 16-bit counts; a format of fewer bits carries the most
// significant ones (Mono12: counts >> 4, Mono8: counts >> 8).

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace atomcam {

/// Codes of the Pixel Format Naming Convention.
enum class PixelFormat : std::uint32_t {
  mono8 = 0x01080001,
  mono12 = 0x01100005,         // 16-bit little endian, upper four bits zero
  mono12_packed = 0x010C0006,  // two pixels in three bytes: p0[11:4], p1[3:0] p0[3:0], p1[11:4]
  mono12p = 0x010C0047,        // little-endian bit stream: p0[7:0], p1[3:0] p0[11:8], p1[11:4]
  mono16 = 0x01100007,         // little endian
};

int bits_per_pixel(PixelFormat format);
std::size_t image_bytes(PixelFormat format, std::size_t pixels);

/// Appends the counts to `bytes` in that format.
void pack(PixelFormat format, std::span<const std::uint16_t> counts, std::vector<std::uint8_t>& bytes);
/// The counts of packed pixels; the bits that the format does not carry are zero.
std::vector<std::uint16_t> unpack(PixelFormat format, std::span<const std::uint8_t> bytes,
                                  std::size_t pixels);

}  // namespace atomcam
