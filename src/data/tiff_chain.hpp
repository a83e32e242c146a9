#pragma once
// Where the pages of a TIFF stand: the chain of directories, read with distrust.

#include <cstdint>
#include <filesystem>
#include <vector>

namespace atomcam {

struct TiffChain {
  std::vector<std::uint64_t> offsets;  // of the pages' directories
  std::uint64_t end = 0;               // of what the directories hold and point to, without the pixels
  std::uint64_t file_size = 0;
  bool big_endian = false;
};

/// Throws an Error that names the file and the page where the chain leaves the file or runs in circles.
TiffChain tiff_chain(const std::filesystem::path& file);

}  // namespace atomcam
