#include <fitsio.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

/// A FITS file of CFITSIO; every call's status goes through `check`.
class Fits {
 public:
  explicit Fits(Path file) : file_(std::move(file)) { fits_clear_errmsg(); }
  ~Fits() {
    int ignored = 0;
    if (handle_) fits_close_file(handle_, &ignored);
  }
  Fits(const Fits&) = delete;
  Fits& operator=(const Fits&) = delete;

  void check(const char* verb) {
    if (status_ == 0) return;
    const int system = errno;
    char message[FLEN_ERRMSG] = "";
    fits_get_errstatus(status_, message);
    fits_clear_errmsg();
    status_ = 0;
    throw Error(file_.string(), cannot(verb, system, message));
  }
  void close(const char* verb) {
    if (!handle_) return;
    errno = 0;
    fits_close_file(std::exchange(handle_, nullptr), &status_);
    check(verb);
  }
  fitsfile** address() { return &handle_; }
  operator fitsfile*() const { return handle_; }
  int* status() { return &status_; }

 private:
  Path file_;
  fitsfile* handle_ = nullptr;
  int status_ = 0;
};

/// A table of one column of texts of any length, behind what the file holds already.
void append_texts(Fits& fits, const char* table, const char* column, const std::vector<std::string>& texts) {
  std::size_t longest = 0;
  for (const std::string& text : texts) longest = std::max(longest, text.size());
  std::string name = column, form = "1PA(" + std::to_string(longest) + ")";
  char* names[] = {name.data()};
  char* forms[] = {form.data()};
  fits_create_tbl(fits, BINARY_TBL, static_cast<LONGLONG>(texts.size()), 1, names, forms, nullptr, table,
                  fits.status());
  for (std::size_t row = 0; row < texts.size() && *fits.status() == 0; ++row) {
    // As raw bytes: CFITSIO's functions for strings lose what is longer than a few thousand letters.
    std::vector<unsigned char> bytes(texts[row].begin(), texts[row].end());
    fits_write_col_byt(fits, 1, static_cast<LONGLONG>(row + 1), 1, static_cast<LONGLONG>(bytes.size()),
                       bytes.data(), fits.status());
  }
  fits.check("written");
}

std::vector<std::string> read_texts(Fits& fits, const char* table) {
  std::string name = table;
  if (fits_movnam_hdu(fits, BINARY_TBL, name.data(), 0, fits.status()) != 0) {
    *fits.status() = 0;
    fits_clear_errmsg();
    return {};
  }
  LONGLONG rows = 0;
  fits_get_num_rowsll(fits, &rows, fits.status());
  std::vector<std::string> texts;
  for (LONGLONG row = 1; row <= rows; ++row) {
    LONGLONG length = 0, offset = 0;
    fits_read_descriptll(fits, 1, row, &length, &offset, fits.status());
    std::vector<unsigned char> bytes(static_cast<std::size_t>(length));
    int any = 0;
    fits_read_col_byt(fits, 1, row, 1, length, 0, bytes.data(), &any, fits.status());
    fits.check("read");
    texts.emplace_back(bytes.begin(), bytes.end());
  }
  return texts;
}

class FitsStackWriter : public StackWriter {
 public:
  FitsStackWriter(const Path& file, Shape shape, const StackNotes& notes, std::uint64_t expected_frames)
      : StackWriter(file, shape),
        fits_(file),
        notes_(notes),
        room_(std::max<std::uint64_t>(1, expected_frames)) {
    std::error_code none;
    std::filesystem::remove(file, none);  // CFITSIO does not replace
    errno = 0;
    fits_create_diskfile(fits_.address(), file.c_str(), fits_.status());
    LONGLONG size[3] = {shape.columns, shape.rows, static_cast<LONGLONG>(room_)};
    fits_create_imgll(fits_, USHORT_IMG, 3, size, fits_.status());
    fits_.check("written");
  }
  ~FitsStackWriter() override {
    try {
      finish();
    } catch (const Error&) {
      // An error is on its way already, or the file was given up.
    }
  }
  void finish() override {
    if (!fits_) return;
    errno = 0;
    resize(frames_);
    if (frames_ == 0) {
      fits_.close("written");
      return;
    }
    append_texts(fits_, "TRUTH", "TRUTH", truth_);
    append_texts(fits_, "NOTES", "NOTES", {open_notes(notes_) + "}"});
    fits_.close("written");
  }

 private:
  void resize(std::uint64_t frames) {
    if (frames == room_) return;
    LONGLONG size[3] = {shape_.columns, shape_.rows, static_cast<LONGLONG>(frames)};
    // With 16 bits and BZERO the type must be given as it is stored.
    fits_resize_imgll(fits_, USHORT_IMG, 3, size, fits_.status());
    fits_.check("written");
    room_ = frames;
  }
  void write(const CountImage& frame, const std::string& truth) override {
    errno = 0;
    if (frames_ == room_) resize(2 * room_);
    const auto pixels = static_cast<LONGLONG>(shape_.pixels());
    auto* data = const_cast<std::uint16_t*>(frame.pixels().data());
    fits_write_img(fits_, TUSHORT, static_cast<LONGLONG>(frames_) * pixels + 1, pixels, data, fits_.status());
    fits_flush_buffer(fits_, 0, fits_.status());
    fits_.check("written");
    truth_.push_back(truth);
  }

  Fits fits_;
  StackNotes notes_;
  std::uint64_t room_;              // frames that the header announces
  std::vector<std::string> truth_;  // FITS keeps tables behind the images
};

class FitsStackReader : public StackReader {
 public:
  explicit FitsStackReader(const Path& file) : StackReader(file), fits_(file) {
    errno = 0;
    fits_open_diskfile(fits_.address(), file.c_str(), READONLY, fits_.status());
    fits_.check("read");
    truth_ = read_texts(fits_, "TRUTH");
    if (const auto notes = read_texts(fits_, "NOTES"); !notes.empty()) set_notes(parse_notes(file, notes[0]));
    int axes = 0, type = 0;
    LONGLONG size[3] = {0, 0, 1};
    fits_movabs_hdu(fits_, 1, nullptr, fits_.status());
    fits_get_img_paramll(fits_, 3, &type, &axes, size, fits_.status());
    fits_.check("read");
    if (axes < 2) throw Error(file.string(), "its primary array is no image");
    set_shape(static_cast<std::uint64_t>(size[2]), static_cast<std::uint64_t>(size[1]),
              static_cast<std::uint64_t>(size[0]), PixelType::uint16);
  }
  std::string truth(std::uint64_t frame) override { return frame < truth_.size() ? truth_[frame] : "null"; }

 private:
  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    int any = 0;
    errno = 0;
    fits_read_img(fits_, TUSHORT, static_cast<LONGLONG>(frame * shape_.pixels()) + 1,
                  static_cast<LONGLONG>(shape_.pixels()), nullptr, pixels.data(), &any, fits_.status());
    fits_.check("read");
  }

  Fits fits_;
  std::vector<std::string> truth_;
};

}  // namespace

std::unique_ptr<StackWriter> write_fits(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames) {
  return std::make_unique<FitsStackWriter>(file, shape, notes, expected_frames);
}

std::unique_ptr<StackReader> read_fits(const Path& file) {
  return std::make_unique<FitsStackReader>(file);
}

}  // namespace atomcam
