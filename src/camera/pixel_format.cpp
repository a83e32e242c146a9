#include "camera/pixel_format.hpp"

#include <bit>

namespace atomcam {

static_assert(std::endian::native == std::endian::little, "16-bit pixels are sent as they lie in memory");

int bits_per_pixel(PixelFormat format) {
  return static_cast<int>((static_cast<std::uint32_t>(format) >> 16) & 0xff);
}

std::size_t image_bytes(PixelFormat format, std::size_t pixels) {
  return (pixels * static_cast<std::size_t>(bits_per_pixel(format)) + 7) / 8;
}

void pack(PixelFormat format, std::span<const std::uint16_t> counts, std::vector<std::uint8_t>& bytes) {
  if (format == PixelFormat::mono16) {
    const auto* begin = reinterpret_cast<const std::uint8_t*>(counts.data());
    bytes.insert(bytes.end(), begin, begin + counts.size_bytes());
    return;
  }
  const std::size_t start = bytes.size();
  bytes.resize(start + image_bytes(format, counts.size()));
  std::uint8_t* out = bytes.data() + start;
  switch (format) {
    case PixelFormat::mono8:
      for (const std::uint16_t count : counts) *out++ = static_cast<std::uint8_t>(count >> 8);
      return;
    case PixelFormat::mono12:
      for (const std::uint16_t count : counts) {
        const int value = count >> 4;
        *out++ = static_cast<std::uint8_t>(value);
        *out++ = static_cast<std::uint8_t>(value >> 8);
      }
      return;
    case PixelFormat::mono12_packed:
    case PixelFormat::mono12p: {
      const bool legacy = format == PixelFormat::mono12_packed;
      for (std::size_t i = 0; i < counts.size(); i += 2) {
        const int first = counts[i] >> 4;
        const bool pair = i + 1 < counts.size();
        const int second = pair ? counts[i + 1] >> 4 : 0;
        *out++ = static_cast<std::uint8_t>(legacy ? first >> 4 : first);
        *out++ = static_cast<std::uint8_t>((second & 0xf) << 4 | (legacy ? first & 0xf : first >> 8));
        if (pair) *out++ = static_cast<std::uint8_t>(second >> 4);
      }
      return;
    }
    case PixelFormat::mono16:
      return;
  }
}

std::vector<std::uint16_t> unpack(PixelFormat format, std::span<const std::uint8_t> bytes,
                                  std::size_t pixels) {
  std::vector<std::uint16_t> counts(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    int value = 0;
    switch (format) {
      case PixelFormat::mono8:
        value = bytes[i] << 8;
        break;
      case PixelFormat::mono12:
        value = (bytes[2 * i] | bytes[2 * i + 1] << 8) << 4;
        break;
      case PixelFormat::mono16:
        value = bytes[2 * i] | bytes[2 * i + 1] << 8;
        break;
      case PixelFormat::mono12_packed: {
        const std::size_t at = i / 2 * 3;
        value = i % 2 == 0 ? bytes[at] << 4 | (bytes[at + 1] & 0xf) : bytes[at + 2] << 4 | bytes[at + 1] >> 4;
        value <<= 4;
        break;
      }
      case PixelFormat::mono12p: {
        const std::size_t at = i / 2 * 3;
        value = i % 2 == 0 ? bytes[at] | (bytes[at + 1] & 0xf) << 8 : bytes[at + 2] << 4 | bytes[at + 1] >> 4;
        value <<= 4;
        break;
      }
    }
    counts[i] = static_cast<std::uint16_t>(value);
  }
  return counts;
}

}  // namespace atomcam
