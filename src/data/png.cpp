#include "data/png.hpp"

#include <png.h>

#include <algorithm>
#include <cerrno>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "data/file.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

/// libpng through its simplified interface into memory. `place`: for errors.
std::vector<std::byte> encode(std::string_view place, Shape shape, png_uint_32 format, const void* pixels) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(shape.columns);
  image.height = static_cast<png_uint_32>(shape.rows);
  image.format = format;
  png_alloc_size_t size = 0;
  std::vector<std::byte> bytes;
  bool good = png_image_write_get_memory_size(image, size, 0, pixels, 0, nullptr) != 0;
  bytes.resize(size);
  good = good && png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels, 0, nullptr) != 0;
  if (!good) throw Error(place, cannot("written", 0, image.message));
  bytes.resize(size);
  return bytes;
}

void write(const std::filesystem::path& file, Shape shape, png_uint_32 format, const void* pixels) {
  const std::vector<std::byte> bytes = encode(file.string(), shape, format, pixels);
  File out(file, "wb");
  out.write(bytes);
  out.close();
}

}  // namespace

void write_png(const std::filesystem::path& file, const CountImage& image, double black, double white) {
  const double scale = white > black ? 65535 / (white - black) : 0;
  std::vector<std::uint16_t> grey(image.shape().pixels());
  std::ranges::transform(image.pixels(), grey.begin(), [&](std::uint16_t count) {
    return static_cast<std::uint16_t>(std::clamp((count - black) * scale, 0.0, 65535.0) + 0.5);
  });
  // libpng takes 16-bit samples as light, which is what counts are.
  write(file, image.shape(), PNG_FORMAT_LINEAR_Y, grey.data());
}

void write_png(const std::filesystem::path& file, const Canvas& canvas) {
  write(file, canvas.shape(), PNG_FORMAT_RGB, canvas.bytes().data());
}

std::vector<std::byte> png_bytes(const Canvas& canvas) {
  return encode("PNG", canvas.shape(), PNG_FORMAT_RGB, canvas.bytes().data());
}

}  // namespace atomcam
