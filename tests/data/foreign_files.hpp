#pragma once
// Files as other programs write them, by encoders of the tests' own.

#include <filesystem>
#include <string>
#include <vector>

#include "data/stack_reader.hpp"

namespace atomcam {

struct ForeignFormat {
  std::string name;
  std::vector<PixelType> types;
  /// Frames of some_pixels(type, ..., n).
  void (*write)(const std::filesystem::path& file, PixelType type, StackShape shape);
};

const std::vector<ForeignFormat>& foreign_formats();

}  // namespace atomcam
