#include <fmt/format.h>

#include <array>
#include <cstring>

#include "base/error.hpp"
#include "data/file.hpp"
#include "data/formats.hpp"

// Hamamatsu's DCIMG, as its users describe it: a file header, a session header, the frames. Formats 0x1000000
// and 0x2000000 put a footer behind each frame: its number, its time, and, over Camera Link, four pixels
// whose place in the frame holds something else. Format 7 keeps these behind all frames.

namespace atomcam {
namespace {

class DcimgStackReader : public StackReader {
 public:
  explicit DcimgStackReader(const Path& file) : StackReader(file), bytes_(file, "rb") {
    bytes_.seek(0, SEEK_END);
    size_ = static_cast<std::uint64_t>(bytes_.position());
    const auto version = word(8);
    if (version != 7 && version != 0x1000000 && version != 0x2000000)
      fail(fmt::format("DCIMG format {:#x}; 0x7, 0x1000000 and 0x2000000 can be read", version));
    session_ = word(40);
    if (session_ > size_) fail("its session lies beyond the end of the file; cut off?");
    if (const std::uint64_t announced = wide(48); announced != size_)
      fail(fmt::format("its header announces {} bytes, it has {}; cut off?", announced, size_));
    if (version == 7)
      read_old();
    else
      read_new(version);
  }

 private:
  std::uint64_t wide(std::uint64_t at) { return number<std::uint64_t>(at); }
  std::uint64_t word(std::uint64_t at) { return number<std::uint32_t>(at); }
  template <class Value>
  std::uint64_t number(std::uint64_t at) {
    Value value{};
    if (at > size_ || size_ - at < sizeof value) fail("its header is cut off");
    bytes_.seek(static_cast<std::int64_t>(at));
    if (!bytes_.read(std::as_writable_bytes(std::span(&value, 1)))) fail("its header is cut off");
    return value;
  }

  void layout(std::uint64_t frames, std::uint64_t depth, std::uint64_t columns, std::uint64_t rows,
              std::uint64_t row_bytes, std::uint64_t image_bytes, std::uint64_t data, std::uint64_t footer) {
    if (depth != 1 && depth != 2) fail(fmt::format("{} bytes per pixel; 1 and 2 can be read", depth));
    set_shape(frames, rows, columns, depth == 1 ? PixelType::uint8 : PixelType::uint16);
    if (row_bytes < columns * depth || image_bytes != row_bytes * rows)
      fail(fmt::format("{} x {} pixels of {} bytes, in rows of {} and images of {}", rows, columns, depth,
                       row_bytes, image_bytes));
    data_ = session_ + data;
    row_bytes_ = row_bytes;
    stride_ = image_bytes + footer;
    const std::uint64_t held = data_ > size_ ? 0 : (size_ - data_) / stride_;
    if (held < frames)
      fail(held, fmt::format("the file ends in it, its header announces {}; cut off?", frames));
  }

  void read_new(std::uint64_t version) {
    const std::uint64_t s = session_;
    const std::uint64_t frames = word(s + 60), image_bytes = word(s + 84), footer = word(s + 124);
    if (word(36) != frames) fail(fmt::format("{} frames in one header, {} in the other", word(36), frames));
    layout(frames, word(s + 64), word(s + 72), word(s + 76), word(s + 80), image_bytes, wide(s + 96), footer);
    // Columns of the sensor that were read; binning divides them.
    if (const std::uint64_t across = number<std::uint16_t>(s + 714);
        across % static_cast<std::uint64_t>(shape_.columns) != 0)
      fail(fmt::format("{} columns, of {} of the sensor", shape_.columns, across));
    if (footer >= 12) {
      for (std::uint64_t n = 0; n < frames; ++n) {
        const std::uint64_t at = data_ + n * stride_ + image_bytes;
        metadata_.timestamps_s.push_back(static_cast<double>(word(at + 4)) +
                                         1e-6 * static_cast<double>(word(at + 8)));
      }
    }
    if (footer != 32 && footer < 512) return;  // no pixels set aside
    aside_ = image_bytes + 12;
    if (version == 0x2000000) {
      aside_row_ = 0;
      return;
    }
    // On the sensor it is row 1023.
    const std::uint64_t first = number<std::uint16_t>(s + 716);
    const std::uint64_t across = number<std::uint16_t>(s + 714);
    const std::uint64_t binning =
        std::max<std::uint64_t>(1, across / static_cast<std::uint64_t>(shape_.columns));
    if (first <= 1023) aside_row_ = (1023 - first) / binning;
  }

  void read_old() {
    const std::uint64_t s = session_;
    const std::uint64_t frames = word(s + 32);
    if (word(36) != frames) fail(fmt::format("{} frames in one header, {} in the other", word(36), frames));
    layout(frames, word(s + 36), word(s + 44), word(s + 52), word(s + 48), word(s + 56), word(s + 68), 0);
    const std::uint64_t footer = s + wide(s + 72);
    const std::uint64_t times = footer + 272 + 4 * frames;
    if (footer > size_ || size_ - footer < 272 + 12 * frames) fail("its footer is cut off");
    for (std::uint64_t n = 0; n < frames; ++n)
      metadata_.timestamps_s.push_back(static_cast<double>(word(times + 8 * n)) +
                                       1e-6 * static_cast<double>(word(times + 8 * n + 4)));
    const std::uint64_t second_offset = wide(footer + 8);
    if (second_offset > size_ || footer + second_offset > size_) fail("its footer is cut off");
    const std::uint64_t second = footer + second_offset;
    const std::uint64_t aside = wide(second + 88);
    if (word(footer + 40) != aside + 8 * frames) return;
    if (aside > size_ || footer + aside + 8 * frames > size_) fail("its footer is cut off");
    old_aside_ = footer + aside;
    aside_row_ = word(second + 100) / row_bytes_;
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    const auto rows = static_cast<std::uint64_t>(shape_.rows);
    const std::size_t line = pixels.size() / rows;
    const std::uint64_t start = data_ + frame * stride_;
    for (std::uint64_t r = 0; r < rows; ++r) {
      if (r == 0 || line != row_bytes_) bytes_.seek(static_cast<std::int64_t>(start + r * row_bytes_));
      if (!bytes_.read(pixels.subspan(r * line, line))) fail(frame, "the file ends in it; cut off?");
    }
    if (!aside_row_ || *aside_row_ >= rows || line < 8) return;
    const std::uint64_t at = old_aside_ ? *old_aside_ + 8 * frame : start + aside_;
    bytes_.seek(static_cast<std::int64_t>(at));
    if (!bytes_.read(pixels.subspan(*aside_row_ * line, 8))) fail(frame, "the file ends in it; cut off?");
  }

  File bytes_;
  std::uint64_t size_ = 0, session_ = 0, data_ = 0, row_bytes_ = 0, stride_ = 0;
  std::uint64_t aside_ = 0;                 // pixels set aside, from the start of their frame
  std::optional<std::uint64_t> old_aside_;  // in format 7: from the start of the file
  std::optional<std::uint64_t> aside_row_;  // where they belong
};

}  // namespace

std::unique_ptr<StackReader> read_dcimg(const Path& file) {
  return std::make_unique<DcimgStackReader>(file);
}

}  // namespace atomcam
