// Exposures, triggers and frames in time.

#include <gtest/gtest.h>

#include "camera/big_endian.hpp"
#include "camera/pixel_format.hpp"
#include "fixtures.hpp"

namespace atomcam::test {
namespace {

TEST(Acquisition, FreeRunningFramesComeInOrderAndFromTheSource) {
  Bench bench(ixon_model());
  make_small(bench);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(10));
  bench.camera->execute("AcquisitionStop");
  const auto frames = bench.sink.frames();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i]->id, i);
    EXPECT_EQ(frames[i]->width, 64u);
    EXPECT_EQ(frames[i]->payload.size(), static_cast<std::size_t>(bench.integer("PayloadSize")));
    const auto counts = unpack(PixelFormat::mono16, frames[i]->payload, 64 * 64);
    EXPECT_EQ(counts[65], 16 * (2 + i));
  }
}

}  // namespace
}  // namespace atomcam::test
