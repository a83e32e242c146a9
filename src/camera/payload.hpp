#pragma once
// What a frame's payload holds: the packed image and, if chunks are on, records [data][id 32][length 32]
// behind it, big endian, the image itself being the first record. Every record's data is padded to a multiple
// of four bytes.

#include <array>
#include <cstdint>
#include <memory>

#include "base/camera_settings.hpp"
#include "camera/frame_source.hpp"
#include "camera/pixel_format.hpp"
#include "camera/transport.hpp"

namespace atomcam {

/// Chunks in the order of ChunkSelector and of their records.
enum class Chunk { frame_id, timestamp, exposure_time, gain, seed, ground_truth };
inline constexpr std::array chunks = {Chunk::frame_id, Chunk::timestamp, Chunk::exposure_time,
                                      Chunk::gain,     Chunk::seed,      Chunk::ground_truth};

inline constexpr std::uint32_t image_chunk_id = 0xA70C0000;
constexpr std::uint32_t chunk_id(Chunk chunk) {
  return image_chunk_id + 1 + static_cast<std::uint32_t>(chunk);
}

struct PayloadLayout {
  PixelFormat format = PixelFormat::mono16;
  std::uint32_t width = 0, height = 0, offset_x = 0, offset_y = 0;
  bool chunk_mode = false;
  std::array<bool, chunks.size()> enabled{};
  std::size_t truth_bytes = 0;  // of the ground-truth chunk

  std::size_t image_size() const;
  std::size_t chunk_size(Chunk chunk) const;
  std::size_t payload_size() const;
  bool operator==(const PayloadLayout&) const = default;
};

struct ChunkValues {
  std::uint64_t frame_id = 0;
  std::uint64_t timestamp_ns = 0;
  double exposure_us = 0;
  double gain = 1;
  std::int64_t seed = 0;
};

/// Fills a frame with an empty payload as it leaves the camera; the timestamp may follow later.
void fill_frame(CameraFrame& frame, const RenderedFrame& rendered, const PayloadLayout& layout,
                const ChunkValues& values);
/// Sets a frame's timestamp, in its chunk too.
void stamp_frame(CameraFrame& frame, const PayloadLayout& layout, std::uint64_t timestamp_ns);

}  // namespace atomcam
