#include <array>
#include <bit>

#include "base/error.hpp"
#include "data/formats.hpp"
#include "data/npy.hpp"
#include "data/npy_header.hpp"

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

class NpyStackReader : public StackReader {
 public:
  explicit NpyStackReader(const Path& file) : StackReader(file), bytes_(file, "rb") {
    bytes_.seek(0, SEEK_END);
    const auto size = static_cast<std::uint64_t>(bytes_.position());
    bytes_.seek(0);
    array_ = parse_npy(file, [&](std::span<std::byte> bytes) { return bytes_.read(bytes); });
    set_shape(array_.frames, array_.rows, array_.columns, array_.type);
    array_.check_size(file, size);
    if (const Path settings = beside(file, ".settings.json"); std::filesystem::exists(settings))
      set_notes(parse_notes(settings, File(settings, "rb").read_all()));
    if (const Path truth = beside(file, ".truth.jsonl"); std::filesystem::exists(truth))
      read_truth(File(truth, "rb").read_all());
  }
  std::string truth(std::uint64_t frame) override { return frame < truth_.size() ? truth_[frame] : "null"; }

 private:
  void read_truth(const std::string& lines) {
    for (std::size_t at = 0; at < lines.size();) {
      const std::size_t end = std::min(lines.find('\n', at), lines.size());
      truth_.push_back(lines.substr(at, end - at));
      at = end + 1;
    }
  }
  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    bytes_.seek(static_cast<std::int64_t>(array_.data + frame * pixels.size()));
    if (!bytes_.read(pixels)) fail(frame, "the file ends in it; cut off?");
    if (array_.swapped) swap_bytes(pixels, bytes_of(type_));
  }

  File bytes_;
  NpyArray array_;
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
