#include "data/tiff_handle.hpp"

namespace atomcam {
namespace {

constexpr std::uint64_t classic_limit =
    0xf0000000u;  // classic TIFF ends at 2^32 bytes; room for tags and truth
constexpr std::uint64_t truth_allowance = 256 * 1024;  // bytes per frame

class TiffStackWriter : public StackWriter {
 public:
  TiffStackWriter(const Path& file, Shape shape, const StackNotes& notes, std::uint64_t expected_frames)
      : StackWriter(file, shape),
        tiff_(file, big(shape, expected_frames) ? "w8" : "w"),
        notes_(open_notes(notes)) {}
  void finish() override {
    tiff_.close();
    if (!tiff_.complaint().empty()) tiff_.fail("written");
  }

 private:
  static bool big(Shape shape, std::uint64_t expected_frames) {
    return expected_frames == 0 || expected_frames * (2 * shape.pixels() + truth_allowance) > classic_limit;
  }
  void write(const CountImage& frame, const std::string& truth) override {
    TIFF* tiff = tiff_.get();
    const std::string description = (frames_ == 0 ? notes_ + "," : "{") + "\"truth\":" + truth + "}";
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, frame.columns());
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, frame.rows());
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, frame.rows());
    TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, description.c_str());
    errno = 0;
    // Uncompressed data are written straight from the given memory, never changed.
    auto* pixels = const_cast<std::uint16_t*>(frame.pixels().data());
    const auto bytes = static_cast<tmsize_t>(frame.pixels().size_bytes());
    tiff_.check(TIFFWriteEncodedStrip(tiff, 0, pixels, bytes) == bytes, "written");
    tiff_.check(TIFFWriteDirectory(tiff) == 1, "written");
  }

  Tiff tiff_;
  std::string notes_;
};

}  // namespace

std::unique_ptr<StackWriter> write_tiff(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames) {
  return std::make_unique<TiffStackWriter>(file, shape, notes, expected_frames);
}

}  // namespace atomcam
