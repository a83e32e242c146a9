#include <gtest/gtest.h>
#include <tiffio.h>

#include <functional>

#include "base/error.hpp"
#include "data/pixels.hpp"
#include "data/stack.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

constexpr Shape shape{19, 23};

struct Kind {
  PixelType type;
  int bits, format;
};
constexpr Kind kinds[] = {
    {PixelType::uint8, 8, SAMPLEFORMAT_UINT},      {PixelType::int8, 8, SAMPLEFORMAT_INT},
    {PixelType::uint16, 16, SAMPLEFORMAT_UINT},    {PixelType::int16, 16, SAMPLEFORMAT_INT},
    {PixelType::uint32, 32, SAMPLEFORMAT_UINT},    {PixelType::int32, 32, SAMPLEFORMAT_INT},
    {PixelType::float32, 32, SAMPLEFORMAT_IEEEFP}, {PixelType::float64, 64, SAMPLEFORMAT_IEEEFP},
};
constexpr Kind counts16 = kinds[2];

struct Layout {
  const char* mode = "w";
  int compression = COMPRESSION_NONE;
  int rows_per_strip = shape.rows;
  int tile = 0;
  std::string description = {};
  Shape size = shape;
};

void add_page(TIFF* tiff, const Kind& kind, const Layout& layout, std::uint64_t frame) {
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, layout.size.columns);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, layout.size.rows);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, layout.compression);
  if (!layout.description.empty() && frame == 0)
    TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, layout.description.c_str());
  auto pixels = some_pixels(kind.type, layout.size.pixels(), frame);
  const auto row_bytes = static_cast<std::size_t>(layout.size.columns) * bytes_of(kind.type);
  if (layout.tile) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, layout.tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, layout.tile);
    std::vector<std::byte> tile(static_cast<std::size_t>(TIFFTileSize(tiff)));
    for (int row = 0; row < layout.size.rows; row += layout.tile) {
      for (int column = 0; column < layout.size.columns; column += layout.tile) {
        std::ranges::fill(tile, std::byte{0});
        for (int r = 0; r < std::min(layout.tile, layout.size.rows - row); ++r)
          for (int c = 0; c < std::min(layout.tile, layout.size.columns - column); ++c)
            std::memcpy(tile.data() + static_cast<std::size_t>(r * layout.tile + c) * bytes_of(kind.type),
                        pixels.data() + static_cast<std::size_t>(row + r) * row_bytes +
                            static_cast<std::size_t>(column + c) * bytes_of(kind.type),
                        bytes_of(kind.type));
        TIFFWriteTile(tiff, tile.data(), static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row),
                      0, 0);
      }
    }
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, layout.rows_per_strip);
    for (int row = 0; row < layout.size.rows; ++row)
      TIFFWriteScanline(tiff, pixels.data() + static_cast<std::size_t>(row) * row_bytes,
                        static_cast<std::uint32_t>(row), 0);
  }
  TIFFWriteDirectory(tiff);
}

void write(const std::filesystem::path& file, const Kind& kind, const Layout& layout, std::uint64_t frames) {
  TIFF* tiff = TIFFOpen(file.c_str(), layout.mode);
  for (std::uint64_t n = 0; n < frames; ++n) add_page(tiff, kind, layout, n);
  TIFFClose(tiff);
}

void expect_frames(const std::filesystem::path& file, const Kind& kind, std::uint64_t frames) {
  const auto reader = open_stack(file);
  ASSERT_EQ(reader->shape(), (StackShape{frames, shape.rows, shape.columns}));
  ASSERT_EQ(reader->type(), kind.type);
  for (std::uint64_t n = frames; n-- > 0;)
    EXPECT_EQ(bytes_of_frame(*reader, n), some_pixels(kind.type, shape.pixels(), n)) << "frame " << n;
}

TEST(TiffReader, EveryTypeAndCompressionIsBitExact) {
  const TemporaryFolder folder;
  int count = 0;
  for (const Kind& kind : kinds) {
    for (const char* mode : {"w", "wb", "w8", "w8b"}) {  // byte orders, BigTIFF
      for (const int compression : {COMPRESSION_NONE, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_LZW}) {
        for (const Layout& layout :
             {Layout{mode, compression}, Layout{mode, compression, 5}, Layout{mode, compression, 0, 16}}) {
          const auto file = folder / ("stack" + std::to_string(count++));  // told by its content
          write(file, kind, layout, 3);
          expect_frames(file, kind, 3);
        }
      }
    }
  }
}

TEST(TiffReader, ConvertsAndRefusesWhatIsNoCount) {
  const TemporaryFolder folder;
  const auto file = folder / "float.tif";
  TIFF* tiff = TIFFOpen(file.c_str(), "w");
  for (const float odd : {7.f, 7.5f, -1.f, 65536.f, std::nanf("")}) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 3);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 32);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    float pixels[6] = {0, 1, 65535, 3, 4, odd};
    TIFFWriteEncodedStrip(tiff, 0, pixels, sizeof pixels);
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
  const auto reader = open_stack(file);
  const CountImage counts = reader->counts(0);
  EXPECT_EQ(counts(0, 2), 65535);
  EXPECT_EQ(counts(1, 2), 7);
  std::vector<double> values(6);
  reader->read(1, std::span(values));
  EXPECT_EQ(values[5], 7.5);
  const char* words[] = {"7.5", "-1", "65536", "nan"};
  for (std::uint64_t n = 1; n < 5; ++n) {
    const std::string text = complaint_of([&] { reader->counts(n); });
    EXPECT_NE(text.find(file.string() + ": frame " + std::to_string(n) + ": pixel [1, 2] is " + words[n - 1]),
              text.npos)
        << text;
  }
}

TEST(TiffReader, ImageJKeepsPlanesBehindOnePage) {
  const TemporaryFolder folder;
  for (const char* mode : {"w", "wb"}) {
    const auto file = folder / "imagej.tif";
    write(file, counts16, {.mode = mode, .description = "ImageJ=1.53t\nimages=4\nslices=4\nloop=false\n"}, 1);
    // ImageJ puts the pixels last: append page and planes behind, and point the page there.
    std::string bytes = bytes_in(file);
    const std::string old_strip = bytes.substr(8, shape.pixels() * 2);
    const auto at = static_cast<std::uint32_t>(bytes.size());
    for (std::uint64_t n = 0; n < 4; ++n) {
      auto pixels = some_pixels(PixelType::uint16, shape.pixels(), n);
      if (mode[1] == 'b')
        for (std::size_t i = 0; i < pixels.size(); i += 2) std::swap(pixels[i], pixels[i + 1]);
      bytes.append(reinterpret_cast<const char*>(pixels.data()), pixels.size());
    }
    const auto word = [&](std::uint32_t value) {
      std::string text;
      for (int i = 0; i < 4; ++i) text += static_cast<char>(value >> (mode[1] == 'b' ? 24 - 8 * i : 8 * i));
      return text;
    };
    const std::string tag = mode[1] == 'b' ? std::string("\x01\x11\x00\x04\x00\x00\x00\x01", 8)
                                           : std::string("\x11\x01\x04\x00\x01\x00\x00\x00", 8);
    const auto entry = bytes.find(tag);
    ASSERT_NE(entry, bytes.npos);
    bytes.replace(entry + 8, 4, word(at));
    write_bytes(file, bytes);
    expect_frames(file, counts16, 4);
    EXPECT_EQ(open_stack(file)->metadata().others.at("slices"), "4");
    write_bytes(file, bytes.substr(0, bytes.size() - 1));
    const std::string text = complaint_of([&] { open_stack(file); });
    EXPECT_NE(text.find("frame 3"), text.npos) << text;
  }
}

TEST(TiffReader, NotesOfImageJAndOmeMustFitThePages) {
  const TemporaryFolder folder;
  const auto file = folder / "stack.tif";
  write(file, counts16, {.description = "ImageJ=1.53t\nimages=5\n"}, 3);
  EXPECT_NE(complaint_of([&] { open_stack(file); }).find("5 images"), std::string::npos);
  const std::string ome =
      "<?xml version=\"1.0\"?><OME><Image ID=\"Image:0\"><Pixels DimensionOrder=\"XYZCT\" Type=\"uint16\" "
      "SizeX=\"23\" "
      "SizeY=\"19\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"3\"><TiffData/><Plane TheT=\"0\" DeltaT=\"0.25\" "
      "ExposureTime=\"0.02\"/><Plane TheT=\"1\" DeltaT=\"0.5\"/><Plane TheT=\"2\" "
      "DeltaT=\"0.75\"/></Pixels></Image></OME>";
  write(file, counts16, {.description = ome}, 3);
  expect_frames(file, counts16, 3);
  const auto reader = open_stack(file);
  EXPECT_EQ(reader->metadata().exposure_s, 0.02);
  EXPECT_EQ(reader->metadata().timestamps_s, (std::vector<double>{0.25, 0.5, 0.75}));
  write(file, counts16, {.description = ome}, 2);
  EXPECT_NE(complaint_of([&] { open_stack(file); }).find("3 planes"), std::string::npos);
}

TEST(TiffReader, PagesMustBeAlike) {
  const TemporaryFolder folder;
  const auto file = folder / "mixed.tif";
  const auto with_last = [&](const Kind& kind, const Layout& layout) {
    TIFF* tiff = TIFFOpen(file.c_str(), "w");
    for (std::uint64_t n = 0; n < 2; ++n) add_page(tiff, counts16, {}, n);
    add_page(tiff, kind, layout, 2);
    TIFFClose(tiff);
    return complaint_of([&] { open_stack(file); });
  };
  const std::string place = file.string() + ": frame 2: ";
  EXPECT_EQ(with_last(counts16, {.size = {19, 24}}), place + "19 x 24 pixels, where frame 0 has 19 x 23");
  EXPECT_EQ(with_last(kinds[3], {}), place + "int16, where frame 0 is uint16");
  EXPECT_EQ(with_last(counts16, {}), "");
}

TEST(TiffReader, AFolderIsAStackInNaturalOrder) {
  const TemporaryFolder folder;
  for (std::uint64_t n = 0; n < 12; ++n) {
    TIFF* tiff = TIFFOpen((folder / ("shot_" + std::to_string(n) + ".tif")).c_str(), "w");
    add_page(tiff, counts16, {}, n);
    TIFFClose(tiff);
  }
  write_bytes(folder / "NOTES.md", "prose");
  expect_frames(folder.path(), counts16, 12);
  expect_frames(folder / "shot_*.tif", counts16, 12);
  EXPECT_EQ(open_stack(folder / "shot_?.tif")->frames(), 10u);
  TIFF* tiff = TIFFOpen((folder / "shot_99.tif").c_str(), "w");
  add_page(tiff, counts16, {.size = {19, 22}}, 0);
  TIFFClose(tiff);
  const std::string text = complaint_of([&] { open_stack(folder.path()); });
  EXPECT_NE(text.find("shot_99.tif: frame 12: 19 x 22"), text.npos) << text;
  write_bytes(folder / "shot_99.tif", "");
  EXPECT_NE(complaint_of([&] { open_stack(folder.path()); }).find("shot_99.tif: the file is empty"),
            text.npos);
}

}  // namespace
}  // namespace atomcam
