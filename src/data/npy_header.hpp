#pragma once
// The header of an array in NumPy's file format, versions 1 to 3.

#include <functional>
#include <span>

#include "data/formats.hpp"

namespace atomcam {

struct NpyArray {
  std::uint64_t frames = 1, rows = 0, columns = 0;
  PixelType type = PixelType::uint16;
  bool swapped = false;    // not this machine's byte order
  std::uint64_t data = 0;  // bytes of the header
  /// Throws an Error at `place` if the array, header and all, has not `size` bytes.
  void check_size(const Path& place, std::uint64_t size) const;
};

/// `read` fills its argument with the next bytes, or returns false. A two-dimensional array is one frame.
NpyArray parse_npy(const Path& place, const std::function<bool(std::span<std::byte>)>& read);

void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value);

}  // namespace atomcam
