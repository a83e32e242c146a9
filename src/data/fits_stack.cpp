#include "data/fits_handle.hpp"

namespace atomcam {
namespace {

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
    // A header that is damaged afterwards tells another shape without a sign; the checksum tells.
    fits_write_chksum(fits_, fits_.status());
    fits_.check("written");
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

}  // namespace

std::unique_ptr<StackWriter> write_fits(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames) {
  return std::make_unique<FitsStackWriter>(file, shape, notes, expected_frames);
}

}  // namespace atomcam
