#include <tiffio.h>

#include <cerrno>
#include <cstdarg>
#include <cstdio>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

constexpr std::uint64_t classic_limit =
    0xf0000000u;  // classic TIFF ends at 2^32 bytes; room for tags and truth
constexpr std::uint64_t truth_allowance = 256 * 1024;  // bytes per frame

struct Close {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};

/// A TIFF handle that keeps the library's last complaint.
class Tiff {
 public:
  Tiff(const Path& file, const char* mode) : file_(file) {
    struct Free {
      void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
    };
    const std::unique_ptr<TIFFOpenOptions, Free> options(TIFFOpenOptionsAlloc());
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &Tiff::hear, this);
    TIFFOpenOptionsSetWarningHandlerExtR(
        options.get(), [](TIFF*, void*, const char*, const char*, va_list) { return 1; }, nullptr);
    errno = 0;
    handle_.reset(TIFFOpenExt(file.c_str(), mode, options.get()));
    if (!handle_) fail(*mode == 'r' ? "read" : "written");
  }
  TIFF* get() const { return handle_.get(); }
  void check(bool done, const char* verb) {
    if (!done) fail(verb);
  }
  [[noreturn]] void fail(const char* verb) { throw Error(file_.string(), cannot(verb, errno, complaint_)); }
  const std::string& complaint() const { return complaint_; }
  void close() { handle_.reset(); }

 private:
  static int hear(TIFF*, void* self, const char*, const char* format, va_list arguments) {
    char text[512];
    std::vsnprintf(text, sizeof text, format, arguments);
    if (auto& complaint = static_cast<Tiff*>(self)->complaint_; complaint.empty()) complaint = text;
    return 1;
  }

  Path file_;
  std::string complaint_;
  std::unique_ptr<TIFF, Close> handle_;
};

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

class TiffStackReader : public StackReader {
 public:
  explicit TiffStackReader(const Path& file) : StackReader(file), tiff_(file, "r") {
    do {
      offsets_.push_back(TIFFCurrentDirOffset(tiff_.get()));
    } while (TIFFReadDirectory(tiff_.get()));
    frames_ = offsets_.size();
    go(0);
    std::uint32_t columns = 0, rows = 0;
    std::uint16_t bits = 0;
    TIFFGetField(tiff_.get(), TIFFTAG_IMAGEWIDTH, &columns);
    TIFFGetField(tiff_.get(), TIFFTAG_IMAGELENGTH, &rows);
    TIFFGetFieldDefaulted(tiff_.get(), TIFFTAG_BITSPERSAMPLE, &bits);
    if (bits != 16) throw Error(file.string(), std::to_string(bits) + " bits per pixel; 16 can be read");
    shape_ = {static_cast<int>(rows), static_cast<int>(columns)};
    const std::string first = description();
    if (first.starts_with("{\"lab\":"))
      notes_ = parse_notes(file, first.substr(0, first.find(",\"truth\":")) + "}");
  }
  CountImage counts(std::uint64_t frame) override {
    go(frame);
    CountImage image(shape_);
    const auto strip = static_cast<std::size_t>(TIFFStripSize(tiff_.get()));
    auto* at = reinterpret_cast<std::byte*>(image.pixels().data());
    const std::size_t bytes = image.pixels().size_bytes();
    for (std::uint32_t s = 0; s < TIFFNumberOfStrips(tiff_.get()); ++s) {
      if (s * strip >= bytes) throw Error(file_.string(), "its pages differ in size");
      const auto room = static_cast<tmsize_t>(std::min(strip, bytes - s * strip));
      tiff_.check(TIFFReadEncodedStrip(tiff_.get(), s, at + s * strip, room) == room, "read");
    }
    return image;
  }
  std::string truth(std::uint64_t frame) override {
    go(frame);
    const std::string text = description();
    // The first key "truth" outside of strings: the notes before it hold none.
    for (const std::string_view start : {"{\"truth\":", ",\"truth\":"}) {
      const auto at = text.find(start);
      if (at != text.npos && text.back() == '}')
        return text.substr(at + start.size(), text.size() - 1 - at - start.size());
    }
    return "null";
  }

 private:
  void go(std::uint64_t frame) {
    if (frame >= frames_) throw Error(file_.string(), "frame " + std::to_string(frame) + " is not in it");
    errno = 0;
    tiff_.check(TIFFSetSubDirectory(tiff_.get(), offsets_[frame]) == 1, "read");
  }
  std::string description() const {
    const char* text = nullptr;
    return TIFFGetField(tiff_.get(), TIFFTAG_IMAGEDESCRIPTION, &text) == 1 && text ? text : "";
  }

  Tiff tiff_;
  std::vector<toff_t> offsets_;
};

}  // namespace

std::unique_ptr<StackWriter> write_tiff(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames) {
  return std::make_unique<TiffStackWriter>(file, shape, notes, expected_frames);
}

std::unique_ptr<StackReader> read_tiff(const Path& file) {
  return std::make_unique<TiffStackReader>(file);
}

}  // namespace atomcam
