#pragma once
// An array [n, rows, columns] in NumPy's file format 1.0, grown along its first axis.

#include <filesystem>
#include <span>

#include "base/image.hpp"
#include "data/file.hpp"

namespace atomcam {

class NpyWriter {
 public:
  /// `type`: NumPy's name, "<u2", "<f4".
  NpyWriter(const std::filesystem::path& file, Shape shape, const char* type);
  /// After every frame the file is whole: the header is written anew.
  void append(std::span<const std::byte> frame);
  void close() { file_.close(); }

 private:
  void write_header();

  File file_;
  Shape shape_;
  const char* type_;
  std::uint64_t frames_ = 0;
};

}  // namespace atomcam
