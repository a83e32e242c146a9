#include <array>
#include <bit>
#include <charconv>

#include "base/error.hpp"
#include "data/formats.hpp"
#include "data/npy.hpp"

namespace atomcam {
namespace {

static_assert(std::endian::native == std::endian::little,
              "arrays are stored little endian as they lie in memory");
constexpr std::size_t header_bytes = 128;  // room for any shape, a multiple of 64

Path beside(const Path& file, const char* ending) {
  Path other = file;
  return other.replace_extension(ending);
}

class NpyStackWriter : public StackWriter {
 public:
  NpyStackWriter(const Path& file, Shape shape, const StackNotes& notes)
      : StackWriter(file, shape), array_(file, shape, "<u2"), truth_(beside(file, ".truth.jsonl"), "wb") {
    File settings(beside(file, ".settings.json"), "wb");
    settings.write(open_notes(notes) + "}\n");
    settings.close();
  }
  void finish() override {
    array_.close();
    truth_.close();
  }

 private:
  void write(const CountImage& frame, const std::string& truth) override {
    truth_.write(truth + "\n");
    truth_.flush();
    array_.append(std::as_bytes(frame.pixels()));
  }

  NpyWriter array_;
  File truth_;
};

/// The value behind 'key': in a header, up to `end`.
std::string_view header_value(const Path& file, std::string_view header, std::string_view key, char end) {
  const auto start = header.find(key);
  if (start == header.npos) throw Error(file.string(), "its header lacks " + std::string(key));
  const auto from = header.find_first_not_of(" :(", start + key.size());
  const auto to = header.find(end, from);
  if (from == header.npos || to == header.npos) throw Error(file.string(), "its header is not NumPy's");
  return header.substr(from, to - from);
}

class NpyStackReader : public StackReader {
 public:
  explicit NpyStackReader(const Path& file) : StackReader(file), array_(file, "rb") {
    std::array<std::byte, 10> start;
    const std::string_view magic("\x93NUMPY\x01", 7);
    if (!array_.read(start) || std::string_view(reinterpret_cast<const char*>(start.data()), 7) != magic)
      throw Error(file.string(), "not an array of NumPy's format 1.0");
    const auto length = std::to_integer<std::size_t>(start[8]) + 256 * std::to_integer<std::size_t>(start[9]);
    std::string header(length, ' ');
    if (!array_.read(std::as_writable_bytes(std::span(header))))
      throw Error(file.string(), "its header is cut off");
    data_ = static_cast<std::int64_t>(start.size() + length);
    if (header_value(file, header, "'descr'", ',') != "'<u2'" ||
        header_value(file, header, "'fortran_order'", ',') != "False")
      throw Error(file.string(), "not a C-ordered array of 16-bit counts");
    read_shape(header_value(file, header, "'shape'", ')'));
    if (const Path settings = beside(file, ".settings.json"); std::filesystem::exists(settings))
      set_notes(parse_notes(settings, File(settings, "rb").read_all()));
    if (const Path truth = beside(file, ".truth.jsonl"); std::filesystem::exists(truth))
      read_truth(File(truth, "rb").read_all());
  }
  std::string truth(std::uint64_t frame) override { return frame < truth_.size() ? truth_[frame] : "null"; }

 private:
  void read_shape(std::string_view text) {
    std::array<std::uint64_t, 3> sizes{};
    const char* at = text.data();
    for (std::uint64_t& size : sizes) {
      while (at < text.end() && (*at == ' ' || *at == ',')) ++at;
      const auto [end, problem] = std::from_chars(at, text.end(), size);
      if (problem != std::errc{})
        throw Error(file_.string(), "its shape (" + std::string(text) + ") is not frames, rows, columns");
      at = end;
    }
    set_shape(sizes[0], sizes[1], sizes[2], PixelType::uint16);
  }
  void read_truth(const std::string& lines) {
    for (std::size_t at = 0; at < lines.size();) {
      const std::size_t end = std::min(lines.find('\n', at), lines.size());
      truth_.push_back(lines.substr(at, end - at));
      at = end + 1;
    }
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    array_.seek(data_ + static_cast<std::int64_t>(frame * pixels.size()));
    if (!array_.read(pixels)) fail(frame, "the file ends before it");
  }

  File array_;
  std::int64_t data_ = 0;
  std::vector<std::string> truth_;
};

}  // namespace

NpyWriter::NpyWriter(const std::filesystem::path& file, Shape shape, const char* type)
    : file_(file, "wb"), shape_(shape), type_(type) {
  write_header();
  file_.flush();
}

void NpyWriter::append(std::span<const std::byte> frame) {
  file_.seek(static_cast<std::int64_t>(header_bytes + frames_ * frame.size()));
  file_.write(frame);
  file_.flush();
  ++frames_;
  write_header();
  file_.flush();
}

void NpyWriter::write_header() {
  std::string header("\x93NUMPY\x01\x00", 8);
  header += static_cast<char>(header_bytes - 10);
  header += '\0';
  header += std::string("{'descr': '") + type_ + "', 'fortran_order': False, 'shape': (" +
            std::to_string(frames_) + ", " + std::to_string(shape_.rows) + ", " +
            std::to_string(shape_.columns) + "), }";
  header.resize(header_bytes - 1, ' ');
  file_.seek(0);
  file_.write(header + "\n");
}

std::unique_ptr<StackWriter> write_npy(const Path& file, Shape shape, const StackNotes& notes,
                                       std::uint64_t) {
  return std::make_unique<NpyStackWriter>(file, shape, notes);
}

std::unique_ptr<StackReader> read_npy(const Path& file) {
  return std::make_unique<NpyStackReader>(file);
}

}  // namespace atomcam
