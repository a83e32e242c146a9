#pragma once
// Pixels of any type, the same in every run: every byte is drawn, so that all values that a type has can
// come.

#include <cmath>
#include <cstring>
#include <vector>

#include "base/random.hpp"
#include "data/stack_reader.hpp"

namespace atomcam {

inline std::vector<std::byte> some_pixels(PixelType type, std::size_t pixels, std::uint64_t frame) {
  std::vector<std::byte> bytes(pixels * bytes_of(type));
  RandomStream random(11, stream_id("tests/data/pixels"), frame, static_cast<std::uint64_t>(type));
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random() & 255);
  return bytes;
}

/// What is in the reader's frame, as it is kept.
inline std::vector<std::byte> bytes_of_frame(StackReader& reader, std::uint64_t frame) {
  std::vector<std::byte> bytes(reader.shape().pixels() * bytes_of(reader.type()));
  reader.read_bytes(frame, bytes);
  return bytes;
}

/// Message of the Error that `action` throws; empty if it throws none.
template <class Action>
std::string complaint_of(const Action& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

}  // namespace atomcam
