#include "data/stack.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <functional>

#include "base/error.hpp"
#include "base/random.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

CountImage some_counts(Shape shape, std::uint64_t frame) {
  CountImage image(shape);
  RandomStream random(5, stream_id("tests/data"), frame, 0);
  for (std::uint16_t& count : image.pixels()) count = static_cast<std::uint16_t>(random());
  image(0, 0) = 0;
  image(0, 1) = 65535;
  image(shape.rows - 1, shape.columns - 1) = 32768;
  return image;
}

std::string some_truth(std::uint64_t frame) {
  return "{\"frame\":" + std::to_string(frame) + ",\"note\":\"caf\xc3\xa9 \\\"x\\\"\",\"atoms\":[" +
         std::string(20 * frame * frame * frame * frame, '1') + "0]}";
}

const StackNotes some_notes{"name = \"a \\\"lab\\\"\"\n# with lines\n",
                            R"({"seed":7,"truth_like":",truth"})"};

class Stack : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("atomcam-data-" + std::to_string(getpid()));
    fs::create_directories(folder_);
    file_ = folder_ / ("stack" + GetParam());
  }
  void TearDown() override { fs::remove_all(folder_); }
  void write(std::uint64_t frames, std::uint64_t expected) {
    const auto writer = StackWriter::create(file_, shape_, some_notes, expected);
    for (std::uint64_t n = 0; n < frames; ++n) writer->append(some_counts(shape_, n), some_truth(n));
    writer->finish();
  }
  void expect(std::uint64_t frames) {
    const auto reader = open_stack(file_);
    ASSERT_EQ(reader->frames(), frames);
    EXPECT_EQ(reader->shape().frame(), shape_);
    EXPECT_EQ(reader->notes(), some_notes);
    for (std::uint64_t i = frames; i-- > 0;) {  // any order
      EXPECT_TRUE(reader->counts(i) == some_counts(shape_, i)) << "frame " << i;
      EXPECT_EQ(reader->truth(i), some_truth(i));
    }
    EXPECT_THROW(reader->counts(frames), Error);
  }

  fs::path folder_, file_;
  Shape shape_{37, 53};
};

TEST_P(Stack, ComesBackAsItWasWritten) {
  write(5, 5);
  expect(5);
}

TEST_P(Stack, EndsWhereTheFramesEnd) {
  write(3, 1000);  // stopped early
  expect(3);
}

TEST_P(Stack, GrowsWhenTheNumberIsUnknown) {
  write(9, 0);
  expect(9);
}

TEST_P(Stack, ReplacesAnExistingFile) {
  write(7, 7);
  write(2, 2);
  expect(2);
}

TEST_P(Stack, CompletesWithoutFinish) {
  {
    const auto writer = StackWriter::create(file_, shape_, some_notes, 4);
    for (std::uint64_t n = 0; n < 2; ++n) writer->append(some_counts(shape_, n), some_truth(n));
  }
  expect(2);
}

TEST_P(Stack, TruthMayBeMissingAndHaveLines) {
  const auto writer = StackWriter::create(file_, shape_, {}, 2);
  writer->append(some_counts(shape_, 0), "");
  writer->append(some_counts(shape_, 1), "{\n\"a\": 1}");
  writer->finish();
  const auto reader = open_stack(file_);
  EXPECT_EQ(reader->truth(0), "null");
  EXPECT_EQ(reader->truth(1), "{ \"a\": 1}");
  EXPECT_EQ(reader->notes(), StackNotes{});
}

/// One line that names the file and says why.
void expect_named(const fs::path& file, const std::string& why, const std::function<void()>& action) {
  try {
    action();
    FAIL() << "no error for " << file;
  } catch (const Error& error) {
    const std::string text = error.what();
    EXPECT_EQ(error.place(), file.string());
    EXPECT_NE(text.find(why), text.npos) << text;
    EXPECT_EQ(text.find('\n'), text.npos) << text;
  }
}

TEST_P(Stack, SaysWhyItCannotBeWritten) {
  const fs::path nowhere = folder_ / "no_such_folder" / ("stack" + GetParam());
  expect_named(nowhere, "No such file or directory", [&] { StackWriter::create(nowhere, shape_, {}, 1); });
}

TEST_P(Stack, SaysWhyItCannotBeRead) {
  expect_named(file_, "no such file", [&] { open_stack(file_); });
  std::ofstream(file_) << "these are no pixels, but enough bytes to look like something at first sight";
  EXPECT_THROW(open_stack(file_), Error);
}

TEST_P(Stack, SaysThatTheDiskIsFull) {
  shape_ = {256, 256};
  // A limit on the size of files stands in for a full disk.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{1 << 20, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  expect_named(file_, "File too large", [&] { write(20, 20); });
  setrlimit(RLIMIT_FSIZE, &before);
}

TEST_P(Stack, RefusesFramesOfAnotherShape) {
  const auto writer = StackWriter::create(file_, shape_, {}, 1);
  EXPECT_THROW(writer->append(CountImage({37, 54}), "{}"), Error);
  writer->append(some_counts(shape_, 0), "{}");
  writer->finish();
}

INSTANTIATE_TEST_SUITE_P(Formats, Stack, testing::ValuesIn(stack_extensions()),
                         [](const auto& format) { return format.param.substr(1); });

TEST(StackFormat, FollowsTheExtension) {
  expect_named("frames.jpg", ".tif, .tiff, .h5, .hdf5, .fits, .npy", [] {
    StackWriter::create("frames.jpg", {2, 2}, {}, 1);
  });
}

TEST(StackFormat, TiffIsClassicWhereThatIsEnough) {
  const fs::path file = fs::temp_directory_path() / ("atomcam-" + std::to_string(getpid()) + ".tif");
  for (const bool big : {false, true}) {
    const auto writer = StackWriter::create(file, {64, 64}, {}, big ? 1'000'000 : 3);
    writer->append(some_counts({64, 64}, 0), "{}");
    writer->finish();
    std::ifstream bytes(file, std::ios::binary);
    char start[4];
    bytes.read(start, 4);
    EXPECT_EQ(start[2], big ? 43 : 42);  // version in the header
  }
  fs::remove(file);
}

}  // namespace
}  // namespace atomcam
