#include "camera/payload.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "camera/big_endian.hpp"

namespace atomcam {

namespace {

constexpr std::size_t record_tail = 8;  // id and length

std::size_t padded(std::size_t bytes) {
  return (bytes + 3) / 4 * 4;
}

void append_tail(std::vector<std::uint8_t>& payload, std::uint32_t id, std::size_t length) {
  payload.resize(payload.size() + record_tail);
  std::uint8_t* tail = payload.data() + payload.size() - record_tail;
  store_big_endian(id, tail);
  store_big_endian(static_cast<std::uint32_t>(length), tail + 4);
}

}  // namespace

std::size_t PayloadLayout::image_size() const {
  return image_bytes(format, std::size_t{width} * height);
}

std::size_t PayloadLayout::chunk_size(Chunk chunk) const {
  return chunk == Chunk::ground_truth ? padded(truth_bytes) : 8;
}

std::size_t PayloadLayout::payload_size() const {
  if (!chunk_mode) return image_size();
  std::size_t size = padded(image_size()) + record_tail;
  for (const Chunk chunk : chunks)
    if (enabled[static_cast<std::size_t>(chunk)]) size += chunk_size(chunk) + record_tail;
  return size;
}

void fill_frame(CameraFrame& frame, const RenderedFrame& rendered, const PayloadLayout& layout,
                const ChunkValues& values) {
  frame.id = values.frame_id;
  frame.timestamp_ns = values.timestamp_ns;
  frame.pixel_format = static_cast<std::uint32_t>(layout.format);
  frame.width = layout.width;
  frame.height = layout.height;
  frame.offset_x = layout.offset_x;
  frame.offset_y = layout.offset_y;
  frame.chunks = layout.chunk_mode;
  frame.image_bytes = layout.image_size();
  std::vector<std::uint8_t>& payload = frame.payload;
  payload.reserve(layout.payload_size());
  pack(layout.format, rendered.counts.pixels(), payload);
  if (!layout.chunk_mode) return;

  payload.resize(padded(payload.size()));
  append_tail(payload, image_chunk_id, payload.size());
  for (const Chunk chunk : chunks) {
    if (!layout.enabled[static_cast<std::size_t>(chunk)]) continue;
    const std::size_t size = layout.chunk_size(chunk);
    const std::size_t at = payload.size();
    payload.resize(at + size);
    std::uint8_t* data = payload.data() + at;
    switch (chunk) {
      case Chunk::frame_id:
        store_big_endian(values.frame_id, data);
        break;
      case Chunk::timestamp:
        store_big_endian(values.timestamp_ns, data);
        break;
      case Chunk::exposure_time:
        store_big_endian(values.exposure_us, data);
        break;
      case Chunk::gain:
        store_big_endian(values.gain, data);
        break;
      case Chunk::seed:
        store_big_endian(static_cast<std::uint64_t>(values.seed), data);
        break;
      case Chunk::ground_truth: {
        std::string truth = rendered.truth;
        if (truth.size() > size)
          truth = fmt::format("{{\"error\":\"truth of {} bytes, chunk of {}\"}}", truth.size(), size);
        std::memcpy(data, truth.data(), std::min(truth.size(), size));
        break;
      }
    }
    append_tail(payload, chunk_id(chunk), size);
  }
}

void stamp_frame(CameraFrame& frame, const PayloadLayout& layout, std::uint64_t timestamp_ns) {
  frame.timestamp_ns = timestamp_ns;
  if (!layout.chunk_mode || !layout.enabled[static_cast<std::size_t>(Chunk::timestamp)]) return;
  std::size_t at = padded(layout.image_size()) + record_tail;
  if (layout.enabled[static_cast<std::size_t>(Chunk::frame_id)])
    at += layout.chunk_size(Chunk::frame_id) + record_tail;
  store_big_endian(timestamp_ns, frame.payload.data() + at);
}

}  // namespace atomcam
