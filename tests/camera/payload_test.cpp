// Packed pixels and chunks, byte by byte.

#include "camera/payload.hpp"

#include <gtest/gtest.h>

#include <map>

#include "base/random.hpp"
#include "camera/big_endian.hpp"

namespace atomcam::test {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes packed(PixelFormat format, std::vector<std::uint16_t> counts) {
  Bytes bytes;
  pack(format, counts, bytes);
  return bytes;
}

TEST(PixelFormats, ByteByByte) {
  EXPECT_EQ(packed(PixelFormat::mono16, {0x1234, 0xABCD}), (Bytes{0x34, 0x12, 0xCD, 0xAB}));
  EXPECT_EQ(packed(PixelFormat::mono12, {0x1234, 0xABCD}), (Bytes{0x23, 0x01, 0xBC, 0x0A}));
  EXPECT_EQ(packed(PixelFormat::mono8, {0x1234, 0xABCD}), (Bytes{0x12, 0xAB}));
  // First pixel 0x123, second 0xABC.
  EXPECT_EQ(packed(PixelFormat::mono12_packed, {0x1234, 0xABCD}), (Bytes{0x12, 0xC3, 0xAB}));
  EXPECT_EQ(packed(PixelFormat::mono12p, {0x1234, 0xABCD}), (Bytes{0x23, 0xC1, 0xAB}));
  EXPECT_EQ(packed(PixelFormat::mono12_packed, {0x1234}), (Bytes{0x12, 0x03}));
  EXPECT_EQ(packed(PixelFormat::mono12p, {0x1234}), (Bytes{0x23, 0x01}));
}

TEST(PixelFormats, CarryTheirMostSignificantBits) {
  RandomStream random(1, stream_id("pixels"), 0, 0);
  std::vector<std::uint16_t> counts(1001);
  for (auto& count : counts) count = static_cast<std::uint16_t>(random());
  const std::pair<PixelFormat, int> kept[] = {{PixelFormat::mono16, 16},
                                              {PixelFormat::mono12, 12},
                                              {PixelFormat::mono12_packed, 12},
                                              {PixelFormat::mono12p, 12},
                                              {PixelFormat::mono8, 8}};
  for (const auto& [format, bits] : kept) {
    const Bytes bytes = packed(format, counts);
    EXPECT_EQ(bytes.size(), image_bytes(format, counts.size()));
    const auto back = unpack(format, bytes, counts.size());
    for (std::size_t i = 0; i < counts.size(); ++i)
      ASSERT_EQ(back[i], counts[i] >> (16 - bits) << (16 - bits)) << bits << " bits, pixel " << i;
  }
}

// Records from the end of a payload, as a client finds them.
std::map<std::uint32_t, Bytes> records(const Bytes& payload) {
  std::map<std::uint32_t, Bytes> found;
  std::size_t end = payload.size();
  while (end > 0) {
    const auto length = load_big_endian<std::uint32_t>(payload.data() + end - 4);
    const auto id = load_big_endian<std::uint32_t>(payload.data() + end - 8);
    EXPECT_EQ(length % 4, 0u);
    EXPECT_LE(length + 8, end);
    if (length + 8 > end) return found;
    const auto* data = payload.data() + end - 8 - length;
    found[id] = Bytes(data, data + length);
    end -= length + 8;
  }
  return found;
}

PayloadLayout small_layout() {
  PayloadLayout layout;
  layout.format = PixelFormat::mono8;
  layout.width = 3;
  layout.height = 3;
  layout.chunk_mode = true;
  layout.enabled.fill(true);
  layout.truth_bytes = 30;
  return layout;
}

RenderedFrame small_frame(std::string truth) {
  RenderedFrame rendered;
  rendered.counts = CountImage(Shape{3, 3}, 0x4200);
  rendered.truth = std::move(truth);
  return rendered;
}

std::shared_ptr<CameraFrame> made(const RenderedFrame& rendered, const PayloadLayout& layout,
                                  const ChunkValues& values) {
  auto frame = std::make_shared<CameraFrame>();
  fill_frame(*frame, rendered, layout, values);
  return frame;
}

TEST(Chunks, AreFoundFromTheEnd) {
  const PayloadLayout layout = small_layout();
  const auto frame = made(small_frame("{\"a\":1}"), layout, {17, 0, 8294.4, 300, -5});
  stamp_frame(*frame, layout, 123456789);
  EXPECT_EQ(frame->payload.size(), layout.payload_size());
  EXPECT_EQ(frame->image_bytes, 9u);
  EXPECT_EQ(frame->timestamp_ns, 123456789u);
  const auto found = records(frame->payload);
  ASSERT_EQ(found.size(), 7u);
  EXPECT_EQ(found.at(image_chunk_id), (Bytes{0x42, 0x42, 0x42, 0x42, 0x42, 0x42, 0x42, 0x42, 0x42, 0, 0, 0}));
  const auto integer = [&](Chunk chunk) {
    return load_big_endian<std::int64_t>(found.at(chunk_id(chunk)).data());
  };
  const auto floating = [&](Chunk chunk) {
    return load_big_endian<double>(found.at(chunk_id(chunk)).data());
  };
  EXPECT_EQ(integer(Chunk::frame_id), 17);
  EXPECT_EQ(integer(Chunk::timestamp), 123456789);
  EXPECT_EQ(floating(Chunk::exposure_time), 8294.4);
  EXPECT_EQ(floating(Chunk::gain), 300);
  EXPECT_EQ(integer(Chunk::seed), -5);
  const Bytes& truth = found.at(chunk_id(Chunk::ground_truth));
  EXPECT_EQ(truth.size(), 32u);
  EXPECT_STREQ(reinterpret_cast<const char*>(truth.data()), "{\"a\":1}");
}

TEST(Chunks, OnlyTheEnabledOnes) {
  for (unsigned mask = 0; mask < 1u << chunks.size(); ++mask) {
    PayloadLayout layout = small_layout();
    for (std::size_t i = 0; i < chunks.size(); ++i) layout.enabled[i] = mask >> i & 1;
    const auto frame = made(small_frame("{}"), layout, {1, 0, 2, 3, 4});
    stamp_frame(*frame, layout, 77);
    ASSERT_EQ(frame->payload.size(), layout.payload_size());
    const auto found = records(frame->payload);
    for (const Chunk chunk : chunks)
      ASSERT_EQ(found.contains(chunk_id(chunk)), layout.enabled[static_cast<std::size_t>(chunk)]);
    if (found.contains(chunk_id(Chunk::timestamp))) {
      ASSERT_EQ(load_big_endian<std::int64_t>(found.at(chunk_id(Chunk::timestamp)).data()), 77);
    }
  }
}

TEST(Chunks, TruthThatDoesNotFitIsNotCut) {
  PayloadLayout layout = small_layout();
  layout.truth_bytes = 64;
  const auto frame = made(small_frame(std::string(65, 'x')), layout, {});
  const Bytes truth = records(frame->payload).at(chunk_id(Chunk::ground_truth));
  EXPECT_STREQ(reinterpret_cast<const char*>(truth.data()), "{\"error\":\"truth of 65 bytes, chunk of 64\"}");
}

}  // namespace
}  // namespace atomcam::test
