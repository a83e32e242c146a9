#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdlib>

#include "base/error.hpp"
#include "data/foreign_files.hpp"
#include "data/pixels.hpp"
#include "data/stack.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

const StackShape shape{5, 19, 23};

class Format : public testing::TestWithParam<ForeignFormat> {};

TEST_P(Format, EveryTypeIsBitExactInAnyOrder) {
  const TemporaryFolder folder;
  const auto file = folder / "stack";
  for (const PixelType type : GetParam().types) {
    SCOPED_TRACE(name_of(type));
    GetParam().write(file, type, shape);
    const auto reader = open_stack(file);
    ASSERT_EQ(reader->shape(), shape);
    ASSERT_EQ(reader->type(), type);
    for (const std::uint64_t n : {4, 0, 2, 1, 3})
      EXPECT_EQ(bytes_of_frame(*reader, n), some_pixels(type, shape.pixels(), n)) << "frame " << n;
    EXPECT_NE(complaint_of([&] { bytes_of_frame(*reader, 5); }).find(file.string()), std::string::npos);
  }
}

/// What a stack may be opened as after damage: an Error that names the file, or the same shape and type with
/// frames that can be read or give an Error. A crash ends the test.
void expect_error_or_same_shape(const std::filesystem::path& file, PixelType type, const std::string& damage,
                                int& errors) {
  SCOPED_TRACE(damage);
  try {
    const auto reader = open_stack(file);
    EXPECT_EQ(reader->shape(), shape);
    EXPECT_EQ(reader->type(), type);
    if (reader->shape() != shape || reader->type() != type) return;
    for (std::uint64_t n = 0; n < reader->frames(); ++n) {
      bytes_of_frame(*reader, n);
      reader->truth(n);
    }
  } catch (const Error& error) {
    ++errors;
    EXPECT_NE(std::string(error.what()).find(file.filename().string()), std::string::npos) << error.what();
  }
}

void damage_and_open(const std::string& bytes, const std::filesystem::path& file, PixelType type) {
  static std::uint64_t times = 0;  // --gtest_repeat draws other damage
  RandomStream random(3, stream_id("tests/data/damage"), times++, 0);
  int errors = 0;
  for (int i = 0; i < 25; ++i) {
    const std::size_t length = random() % (bytes.size() - 8);
    write_bytes(file, bytes.substr(0, length));
    expect_error_or_same_shape(file, type, "cut off at " + std::to_string(length), errors);
    EXPECT_EQ(errors, i + 1) << "cut off at " << length << " of " << bytes.size();  // something is missing
  }
  // Most of what is damaged below is headers: they are where harm is done.
  for (int i = 0; i < 75; ++i) {
    std::string damaged = bytes;
    const std::size_t at =
        i < 50 ? random() % std::min<std::size_t>(bytes.size(), 3000) : random() % bytes.size();
    const auto flip = static_cast<char>(1 + random() % 255);
    damaged[at] = static_cast<char>(damaged[at] ^ flip);
    write_bytes(file, damaged);
    expect_error_or_same_shape(file, type, "byte " + std::to_string(at) + " ^ " + std::to_string(flip & 255),
                               errors);
  }
}

TEST_P(Format, DamageIsAnErrorOrLeavesTheShape) {
  const TemporaryFolder folder;
  const auto file = folder / "stack";
  const PixelType type = GetParam().types.back();
  GetParam().write(file, type, shape);
  damage_and_open(bytes_in(file), file, type);
}

INSTANTIATE_TEST_SUITE_P(Foreign, Format, testing::ValuesIn(foreign_formats()),
                         [](const auto& format) { return format.param.name; });

class OwnFormat : public testing::TestWithParam<std::string> {};

TEST_P(OwnFormat, DamageIsAnErrorOrLeavesTheShape) {
  const TemporaryFolder folder;
  const auto file = folder / ("stack" + GetParam());
  const auto writer =
      StackWriter::create(file, shape.frame(), {"name = \"lab\"\n", R"({"exposure_s":0.02})"}, shape.frames);
  for (std::uint64_t n = 0; n < shape.frames; ++n)
    writer->append(CountImage(shape.frame(), 1000), R"({"frame":0})");
  writer->finish();
  EXPECT_EQ(open_stack(file)->metadata().exposure_s, 0.02);
  damage_and_open(bytes_in(file), file, PixelType::uint16);
}

INSTANTIATE_TEST_SUITE_P(Formats, OwnFormat, testing::ValuesIn(stack_extensions()),
                         [](const auto& format) { return format.param.substr(1); });

TEST(Formats, PartsAreChosenByName) {
  const TemporaryFolder folder;
  const auto write = [&](const std::string& name, const std::string& format) {
    for (const ForeignFormat& foreign : foreign_formats())
      if (foreign.name == format) foreign.write(folder / name, PixelType::uint16, shape);
  };
  write("a.h5", "hdf5");
  write("a.npz", "npz_deflate");
  write("a.tif", "tiff");
  EXPECT_EQ(open_stack(folder / "a.h5:/images/side/fluorescence/atoms")->shape(), shape);
  EXPECT_EQ(open_stack(folder / "a.npz:arr_0")->shape(), shape);
  EXPECT_NE(complaint_of([&] { open_stack(folder / "a.h5:/images/top"); }).find("no dataset '/images/top'"),
            std::string::npos);
  EXPECT_NE(complaint_of([&] { open_stack(folder / "a.npz:b"); }).find("arr_0"), std::string::npos);
  EXPECT_NE(complaint_of([&] { open_stack(folder / "a.tif:b"); }).find("parts"), std::string::npos);
}

TEST(Formats, MetadataIsKept) {
  const TemporaryFolder folder;
  const auto file = folder / "stack";
  const auto open = [&](const std::string& format) {
    for (const ForeignFormat& foreign : foreign_formats())
      if (foreign.name == format) foreign.write(file, foreign.types.back(), shape);
    return open_stack(file)->metadata();
  };
  EXPECT_EQ(open("fits").exposure_s, 0.03);
  const StackMetadata sif = open("sif");
  EXPECT_EQ(sif.exposure_s, 0.0145);
  EXPECT_EQ(sif.em_gain, 56);
  EXPECT_EQ(sif.temperature_c, -80);
  EXPECT_EQ(sif.camera, "DU897_BV");
  ASSERT_EQ(sif.timestamps_s.size(), 5u);
  EXPECT_DOUBLE_EQ(sif.timestamps_s[4], 4 * 0.0296);
  EXPECT_EQ(open("dcimg").timestamps_s, (std::vector<double>{100.25, 101.25, 102.25, 103.25, 104.25}));
}

// A stack of 4 GB that takes no room on the disk: reading its last frame must not take it in memory.
TEST(Formats, StacksLargerThanMemoryAreReadFrameByFrame) {
  const TemporaryFolder folder;
  const auto file = folder / "large.npy";
  std::string header = "{'descr': '<u2', 'fortran_order': False, 'shape': (4096, 1024, 512), }";
  header.resize(117, ' ');
  write_bytes(file, std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + "\n");
  std::filesystem::resize_file(file, 128 + 4096ull * 1024 * 512 * 2);
  const auto reader = open_stack(file);
  EXPECT_EQ(reader->shape(), (StackShape{4096, 1024, 512}));
  const auto most_memory = [] {  // KiB
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
  };
  const auto before = most_memory();
  std::vector<double> frame(reader->shape().pixels());
  for (std::uint64_t n = 0; n < reader->frames(); n += 16) reader->read(n, std::span(frame));
  EXPECT_LT(most_memory() - before, 64 * 1024);  // of 256 frames of 1 MiB
}

}  // namespace
}  // namespace atomcam
