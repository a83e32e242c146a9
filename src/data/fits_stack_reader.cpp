#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "data/fits_handle.hpp"

namespace atomcam {
namespace {

constexpr LONGLONG most_text_bytes = 1 << 28;

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
    fits.check("read");
    if (length < 0 || length > most_text_bytes)
      throw Error(fits.file().string(),
                  std::string(table) + ": a text of " + std::to_string(length) + " bytes");
    std::vector<unsigned char> bytes(static_cast<std::size_t>(length));
    int any = 0;
    fits_read_col_byt(fits, 1, row, 1, length, 0, bytes.data(), &any, fits.status());
    fits.check("read");
    texts.emplace_back(bytes.begin(), bytes.end());
  }
  return texts;
}

constexpr std::size_t most_keywords = 1000;

struct Kind {
  int image;   // CFITSIO's name for the type after BZERO
  int memory;  // and in memory
  PixelType type;
};
constexpr Kind kinds[] = {
    {BYTE_IMG, TBYTE, PixelType::uint8},         {SBYTE_IMG, TSBYTE, PixelType::int8},
    {USHORT_IMG, TUSHORT, PixelType::uint16},    {SHORT_IMG, TSHORT, PixelType::int16},
    {ULONG_IMG, TUINT, PixelType::uint32},       {LONG_IMG, TINT, PixelType::int32},
    {LONGLONG_IMG, TLONGLONG, PixelType::int64}, {FLOAT_IMG, TFLOAT, PixelType::float32},
    {DOUBLE_IMG, TDOUBLE, PixelType::float64},
};

class FitsStackReader : public StackReader {
 public:
  explicit FitsStackReader(const Path& file) : StackReader(file), fits_(file) {
    errno = 0;
    fits_open_diskfile(fits_.address(), file.c_str(), READONLY, fits_.status());
    fits_.check("read");
    const std::uint64_t file_size = std::filesystem::file_size(file);
    int units = 0;
    fits_get_num_hdus(fits_, &units, fits_.status());
    fits_.check("read");
    std::uint64_t end = 0, frames = 0, rows = 0, columns = 0;
    PixelType type{};
    for (int unit = 1; unit <= units; ++unit) {
      int kind = 0, axes = 0, stored = 0;
      fits_movabs_hdu(fits_, unit, &kind, fits_.status());
      LONGLONG head = 0, data = 0, unit_end = 0;
      fits_get_hduaddrll(fits_, &head, &data, &unit_end, fits_.status());
      fits_.check("read");
      end = std::max(end, static_cast<std::uint64_t>(unit_end));
      if (kind != IMAGE_HDU) {
        check_sum();
        continue;
      }
      LONGLONG size[3] = {0, 0, 1};
      fits_get_img_paramll(fits_, 3, &stored, &axes, size, fits_.status());
      fits_get_img_equivtype(fits_, &stored, fits_.status());
      fits_.check("read");
      if (axes == 0) continue;
      if (axes < 2 || axes > 3 || std::ranges::any_of(size, [](LONGLONG side) { return side < 0; }))
        fail(frames, fmt::format("an image of {} axes; 2 or 3 can be read", axes));
      if (axes == 2) size[2] = 1;
      const auto found = std::ranges::find(kinds, stored, &Kind::image);
      if (found == std::end(kinds)) fail(frames, fmt::format("pixels of FITS type {}", stored));
      const std::uint64_t unit_frames = static_cast<std::uint64_t>(size[2]);
      if (units_.empty()) {
        rows = static_cast<std::uint64_t>(size[1]), columns = static_cast<std::uint64_t>(size[0]);
        type = found->type;
        memory_ = found->memory;
      } else if (rows != static_cast<std::uint64_t>(size[1]) ||
                 columns != static_cast<std::uint64_t>(size[0])) {
        fail(frames,
             fmt::format("{} x {} pixels, where frame 0 has {} x {}", size[1], size[0], rows, columns));
      } else if (type != found->type) {
        fail(frames, fmt::format("{}, where frame 0 is {}", name_of(found->type), name_of(type)));
      }
      set_shape(unit_frames, rows, columns, type);  // checks it
      const bool compressed = fits_is_compressed_image(fits_, fits_.status());
      const std::uint64_t room =
          file_size > static_cast<std::uint64_t>(data) ? file_size - static_cast<std::uint64_t>(data) : 0;
      int bits = 0;
      fits_get_img_type(fits_, &bits, fits_.status());
      fits_.check("read");
      const std::uint64_t frame_bytes = rows * columns * static_cast<std::uint64_t>(std::abs(bits)) / 8;
      if (!compressed && room / frame_bytes < unit_frames)
        fail(frames + room / frame_bytes,
             fmt::format("the file ends in it, its header announces {}; cut off?", unit_frames));
      check_sum();
      if (units_.empty()) read_keywords();
      units_.push_back({unit, frames});
      frames += unit_frames;
    }
    if (units_.empty()) fail("it holds no image");
    if (end > file_size) fail(fmt::format("it should have {} bytes and has {}; cut off?", end, file_size));
    if (file_size > end) fail(fmt::format("{} bytes follow what its headers announce", file_size - end));
    set_shape(frames, rows, columns, type);
    truth_ = read_texts(fits_, "TRUTH");
    if (const auto notes = read_texts(fits_, "NOTES"); !notes.empty()) set_notes(parse_notes(file, notes[0]));
    current_ = 0;
  }
  std::string truth(std::uint64_t frame) override { return frame < truth_.size() ? truth_[frame] : "null"; }

 private:
  struct Unit {
    int number;
    std::uint64_t first;  // of its frames
  };

  /// Of the unit that is current, where it has one.
  void check_sum() {
    int data = 0, unit = 0;
    fits_verify_chksum(fits_, &data, &unit, fits_.status());
    fits_.check("read");
    if (data < 0 || unit < 0) fail("its bytes do not have the checksum that it notes; damaged?");
  }

  void read_keywords() {
    int count = 0;
    fits_get_hdrspace(fits_, &count, nullptr, fits_.status());
    fits_.check("read");
    for (int i = 1; i <= count && metadata_.others.size() < most_keywords; ++i) {
      char name[FLEN_KEYWORD] = "", value[FLEN_VALUE] = "", comment[FLEN_COMMENT] = "";
      if (fits_read_keyn(fits_, i, name, value, comment, fits_.status()) != 0) {
        *fits_.status() = 0;
        fits_clear_errmsg();
        continue;
      }
      std::string text = value;
      if (text.size() >= 2 && text.front() == '\'') text = text.substr(1, text.find_last_of('\'') - 1);
      while (!text.empty() && text.back() == ' ') text.pop_back();
      if (*name && !text.empty()) metadata_.others[name] = text;
    }
    const auto number = [&](std::initializer_list<const char*> names, std::optional<double>& field) {
      for (const char* name : names) {
        const auto found = metadata_.others.find(name);
        double value = 0;
        if (field || found == metadata_.others.end()) continue;
        const std::string& text = found->second;
        if (std::from_chars(text.data(), text.data() + text.size(), value).ec == std::errc{}) field = value;
      }
    };
    number({"EXPTIME", "EXPOSURE"}, metadata_.exposure_s);
    number({"EMGAIN", "EM_GAIN"}, metadata_.em_gain);
    number({"CCD-TEMP", "TEMP"}, metadata_.temperature_c);
    if (const auto camera = metadata_.others.find("INSTRUME"); camera != metadata_.others.end())
      metadata_.camera = camera->second;
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    const auto next = std::ranges::upper_bound(units_, frame, {}, &Unit::first);
    const Unit& unit = *(next - 1);
    errno = 0;
    if (current_ != unit.number) {
      current_ = 0;
      fits_movabs_hdu(fits_, unit.number, nullptr, fits_.status());
      fits_.check("read");
      current_ = unit.number;
    }
    int any = 0;
    const std::uint64_t first = (frame - unit.first) * shape_.pixels() + 1;
    if (fits_read_img(fits_, memory_, static_cast<LONGLONG>(first), static_cast<LONGLONG>(shape_.pixels()),
                      nullptr, pixels.data(), &any, fits_.status()) != 0) {
      char message[FLEN_ERRMSG] = "";
      fits_get_errstatus(*fits_.status(), message);
      fits_clear_errmsg();
      *fits_.status() = 0;
      fail(frame, cannot("read", errno, message));
    }
  }

  Fits fits_;
  std::vector<Unit> units_;
  int memory_ = TUSHORT;
  int current_ = 0;
  std::vector<std::string> truth_;
};

}  // namespace

std::unique_ptr<StackReader> read_fits(const Path& file) {
  return std::make_unique<FitsStackReader>(file);
}

}  // namespace atomcam
