#pragma once
// PNG files: 16-bit grey images with linear contrast, and drawings.

#include <cstddef>
#include <filesystem>
#include <vector>

#include "base/image.hpp"
#include "data/canvas.hpp"

namespace atomcam {

/// 16-bit grey; counts at or below `black` become 0, at or above `white` 65535, linear between.
void write_png(const std::filesystem::path& file, const CountImage& image, double black, double white);
/// 8-bit colour.
void write_png(const std::filesystem::path& file, const Canvas& canvas);
/// The same as the bytes of a file.
std::vector<std::byte> png_bytes(const Canvas& canvas);

}  // namespace atomcam
