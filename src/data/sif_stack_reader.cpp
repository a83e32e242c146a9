#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "base/error.hpp"
#include "data/file.hpp"
#include "data/formats.hpp"

// Andor's multi-channel file, as its users describe it: lines of text, the first block of them about the
// signal; then 32-bit floating point, little endian, frame after frame. Other blocks (background, reference)
// may follow.

namespace atomcam {
namespace {

constexpr std::size_t most_header_bytes = 1 << 18;  // before the frames' times
constexpr int with_flag_line = 65560;  // versions from here on have a line between times and pixels

class SifStackReader : public StackReader {
 public:
  explicit SifStackReader(const Path& file) : StackReader(file), bytes_(file, "rb") {
    bytes_.seek(0, SEEK_END);
    size_ = static_cast<std::uint64_t>(bytes_.position());
    bytes_.seek(0);
    std::string head(std::min<std::uint64_t>(size_, most_header_bytes), '\0');
    if (!bytes_.read(std::as_writable_bytes(std::span(head)))) fail("cannot be read");
    read_times_and_gain(head);
    // The image's area follows the name of its axis, without a space.
    const std::string_view axis = "Pixel number655";
    const auto area = head.find(axis);
    if (area == head.npos) fail("no area of an image in its header; cut off?");
    at_ = area + axis.size() - 3;
    const auto words = numbers(line(head));
    if (words.size() < 9) fail("its header's area of the image is cut off");
    const double images = words[5], parts = words[6], total = words[7], pixels = words[8];
    if (parts != 1) fail(fmt::format("frames of {} parts; 1 can be read", parts));
    const auto region = numbers(line(head));
    if (region.size() < 7) fail("its header's region of the image is cut off");
    const double left = region[1], top = region[2], right = region[3], bottom = region[4];
    const double down = region[5], across = region[6];
    if (!(down >= 1) || !(across >= 1)) fail(fmt::format("binning {} x {}", down, across));
    const double columns = std::floor((right - left + 1) / across),
                 rows = std::floor((top - bottom + 1) / down);
    if (!(columns >= 1 && rows >= 1 && columns < 1e9 && rows < 1e9 && images >= 1 && images < 1e9))
      fail(fmt::format("{} images of {} x {} pixels", images, rows, columns));
    if (pixels != rows * columns || total != images * pixels)
      fail(fmt::format("its header announces {} images of {} pixels, {} in all, and a region of {} x {}",
                       images, pixels, total, rows, columns));
    set_shape(static_cast<std::uint64_t>(images), static_cast<std::uint64_t>(rows),
              static_cast<std::uint64_t>(columns), PixelType::float32);
    find_pixels();
  }

 private:
  /// The rest of the line at at_, which moves behind it.
  std::string_view line(std::string_view text) {
    const std::size_t start = std::min(at_, text.size());
    const std::size_t end = std::min(text.find('\n', start), text.size());
    at_ = end + 1;
    return text.substr(start, end - start);
  }

  static std::vector<double> numbers(std::string_view text) {
    std::vector<double> values;
    for (std::size_t at = 0; at < text.size();) {
      if (text[at] == ' ' || text[at] == '\r') {
        ++at;
        continue;
      }
      double value = 0;
      const auto [end, problem] = std::from_chars(text.data() + at, text.data() + text.size(), value);
      if (problem != std::errc{}) break;
      values.push_back(value);
      at = static_cast<std::size_t>(end - text.data());
    }
    return values;
  }

  /// The third line: version 0 0 1 time temperature, ten bytes that are no text, 0 exposure cycle
  /// accumulated-cycle accumulations, two such bytes, stack-cycle pixel-readout 0 1 gain ...
  void read_times_and_gain(std::string_view head) {
    at_ = 0;
    line(head);
    line(head);
    const std::size_t start = std::min(at_, head.size());
    std::size_t at = start;
    const auto words = [&](int count) {
      std::vector<double> values;
      for (int i = 0; i < count && at < head.size(); ++i) {
        const std::size_t end = std::min(head.find(' ', at), head.size());
        const auto value = numbers(head.substr(at, end - at));
        if (value.empty()) return std::vector<double>{};
        values.push_back(value[0]);
        at = end + 1;
      }
      return values;
    };
    const auto first = words(6);
    if (first.size() < 6) fail("its header's third line is none of a signal");
    version_ = static_cast<int>(std::clamp(first[0], 0.0, 1e6));
    metadata_.temperature_c = first[5];
    metadata_.others["experiment_time"] = fmt::format("{:.0f}", first[4]);
    at += 10;
    const auto times = words(5);
    if (times.size() < 5) return;
    metadata_.exposure_s = times[1];
    cycle_s_ = times[2];
    metadata_.others["accumulations"] = fmt::format("{}", times[4]);
    at += 2;
    if (const auto rest = words(5); rest.size() == 5) {
      metadata_.others["pixel_readout_s"] = fmt::format("{}", rest[1]);
      metadata_.em_gain = rest[4];
    }
    at_ = start;
    line(head);
    std::string camera(line(head));
    while (!camera.empty() && (camera.back() == ' ' || camera.back() == '\r')) camera.pop_back();
    metadata_.camera = camera;
  }

  /// Behind a line with the time of each frame.
  void find_pixels() {
    const std::uint64_t frame_bytes = shape_.pixels() * sizeof(float);
    if (frames() > size_ / frame_bytes)
      fail(size_ / frame_bytes,
           fmt::format("the file ends before it, its header announces {}; cut off?", frames()));
    bytes_.seek(static_cast<std::int64_t>(at_));
    std::uint64_t position = at_;
    for (std::uint64_t n = 0; n < frames(); ++n) {
      const auto time = numbers(next_line(position));
      if (time.size() != 1) fail(n, "no line with its time in the header");
      metadata_.timestamps_s.push_back(time[0] * 1e-6);
    }
    if (std::ranges::all_of(metadata_.timestamps_s, [](double time) { return time == 0; })) {
      for (std::uint64_t n = 0; n < frames(); ++n)
        metadata_.timestamps_s[n] = static_cast<double>(n) * cycle_s_;
    }
    if (version_ >= with_flag_line) {
      const std::string flag = next_line(position);
      if (flag == "1") {
        for (std::uint64_t n = 0; n < frames(); ++n) next_line(position);
      } else if (flag != "0") {
        fail("no line '0' or '1' between its header and its pixels");
      }
    }
    data_ = position;
    if ((size_ - data_) / frame_bytes < frames())
      fail((size_ - data_) / frame_bytes,
           fmt::format("the file ends in it, its header announces {}; cut off?", frames()));
    // What follows begins with a digit: whether another block comes.
    if (const std::uint64_t end = data_ + frames() * frame_bytes; end < size_) {
      std::byte next{};
      bytes_.seek(static_cast<std::int64_t>(end));
      if (bytes_.read(std::span(&next, 1)) && (next < std::byte{'0'} || next > std::byte{'9'}))
        fail("what follows its pixels is not another block of text");
    }
  }
  std::string next_line(std::uint64_t& position) {
    std::string text;
    std::byte letter{};
    while (text.size() < 200 && bytes_.read(std::span(&letter, 1))) {
      ++position;
      if (letter == std::byte{'\n'}) return text;
      text += static_cast<char>(letter);
    }
    fail("its header is cut off");
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    bytes_.seek(static_cast<std::int64_t>(data_ + frame * pixels.size()));
    if (!bytes_.read(pixels)) fail(frame, "the file ends in it; cut off?");
  }

  File bytes_;
  std::uint64_t size_ = 0, data_ = 0;
  std::size_t at_ = 0;
  int version_ = 0;
  double cycle_s_ = 0;
};

}  // namespace

std::unique_ptr<StackReader> read_sif(const Path& file) {
  return std::make_unique<SifStackReader>(file);
}

}  // namespace atomcam
