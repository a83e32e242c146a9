#include "data/png.hpp"

#include <gtest/gtest.h>
#include <png.h>
#include <unistd.h>

#include "base/error.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

struct Png : testing::Test {
  fs::path file = fs::temp_directory_path() / ("atomcam-" + std::to_string(getpid()) + ".png");
  ~Png() override { fs::remove(file); }
};

/// As stored, without a change of gamma: bit depth, colour type and samples.
struct Stored {
  int depth = 0, type = 0;
  std::vector<std::vector<png_byte>> rows;
};

Stored read(const fs::path& file) {
  Stored stored;
  FILE* in = std::fopen(file.c_str(), "rb");
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, in);
  png_read_png(png, info, PNG_TRANSFORM_IDENTITY, nullptr);
  stored.depth = png_get_bit_depth(png, info);
  stored.type = png_get_color_type(png, info);
  png_bytepp rows = png_get_rows(png, info);
  for (png_uint_32 r = 0; r < png_get_image_height(png, info); ++r)
    stored.rows.emplace_back(rows[r], rows[r] + png_get_rowbytes(png, info));
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(in);
  return stored;
}

TEST_F(Png, GreyIsSixteenBitAndLinear) {
  CountImage image({2, 3});
  const std::uint16_t counts[] = {0, 100, 150, 200, 300, 65535};
  std::ranges::copy(counts, image.pixels().begin());
  write_png(file, image, 100, 300);
  const Stored stored = read(file);
  EXPECT_EQ(stored.depth, 16);
  EXPECT_EQ(stored.type, PNG_COLOR_TYPE_GRAY);
  const int expected[] = {0, 0, 16384, 32768, 65535, 65535};
  for (std::size_t i = 0; i < 6; ++i) {
    const auto& row = stored.rows.at(i / 3);
    EXPECT_EQ(256 * row[2 * (i % 3)] + row[2 * (i % 3) + 1], expected[i]) << i;
  }
}

TEST_F(Png, DrawingsKeepTheirColours) {
  Canvas canvas({40, 50});
  canvas.set(3, 4, {1, 2, 3});
  canvas.set(-1, 99, {9, 9, 9});
  canvas.circle(20, 25, 10, {0, 255, 0});
  canvas.text(1, 10, "I", {255, 0, 0}, 1);
  write_png(file, canvas);
  const Stored stored = read(file);
  ASSERT_EQ(stored.rows.size(), 40u);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 50; ++c)
      for (int k = 0; k < 3; ++k) ASSERT_EQ(stored.rows[r][3 * c + k], canvas.at(r, c)[k]);
  EXPECT_EQ(canvas.at(3, 4), (Colour{1, 2, 3}));
  EXPECT_EQ(canvas.at(20, 35), (Colour{0, 255, 0}));
  EXPECT_EQ(canvas.at(10, 25), (Colour{0, 255, 0}));
  EXPECT_EQ(canvas.at(4, 12), (Colour{255, 0, 0}));  // the letter's stem
}

TEST_F(Png, SaysWhyItCannotBeWritten) {
  EXPECT_THROW(write_png("/no/such/folder/x.png", Canvas({2, 2})), Error);
}

}  // namespace
}  // namespace atomcam
