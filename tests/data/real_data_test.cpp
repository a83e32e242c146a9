// Frames of real cameras and of an independent generator, from the folder that ATOMCAM_DATA names.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "data/stack_reader.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

class RealData : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("ATOMCAM_DATA");
    if (!folder) GTEST_SKIP() << "ATOMCAM_DATA names no folder with real and practice stacks";
    folder_ = folder;
  }
  fs::path folder_;
};

TEST_F(RealData, EveryFrameOfEveryStackIsRead) {
  std::uint64_t files = 0, frames = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder_)) {
    const fs::path ending = entry.path().extension();
    if (ending != ".tif" && ending != ".tiff") continue;
    SCOPED_TRACE(entry.path());
    const auto reader = open_stack(entry.path());
    ++files;
    ASSERT_GT(reader->frames(), 0u);
    std::vector<double> pixels(reader->shape().pixels());
    for (std::uint64_t n = 0; n < reader->frames(); ++n, ++frames) {
      reader->read(n, std::span(pixels));
      for (const double value : pixels) ASSERT_TRUE(std::isfinite(value));
    }
  }
  EXPECT_GT(files, 0u);
  std::printf("%llu files, %llu frames\n", static_cast<unsigned long long>(files),
              static_cast<unsigned long long>(frames));
}

TEST_F(RealData, PracticeStacksHaveTheirShape) {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "practice")) {
    if (!entry.is_directory()) continue;
    EXPECT_EQ(open_stack(entry.path() / "frames.tif")->shape(), (StackShape{300, 96, 96})) << entry.path();
    EXPECT_EQ(open_stack(entry.path() / "darks.tif")->shape(), (StackShape{100, 96, 96})) << entry.path();
  }
}

TEST_F(RealData, SingleFramesOfAFolder) {
  const fs::path folder = folder_ / "real" / "jqi-andor512-emccd";
  const auto off = open_stack(folder / "Background_*.tiff");
  EXPECT_EQ(off->frames(), 46u);
  EXPECT_EQ(open_stack(folder / "Probe_*.tiff")->frames(), 12u);
  EXPECT_EQ(off->counts(45), open_stack(folder / "Background_2020_11_24_0190.tiff")->counts(0));
}

}  // namespace
}  // namespace atomcam
