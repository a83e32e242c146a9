#include <fmt/format.h>
#include <fnmatch.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "base/error.hpp"
#include "data/file.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

struct Format {
  std::string_view start;  // of the file
  std::unique_ptr<StackReader> (*read)(const Path& file, const std::string& part);
};

template <std::unique_ptr<StackReader> (*read)(const Path&)>
std::unique_ptr<StackReader> whole(const Path& file, const std::string& part) {
  if (!part.empty())
    throw Error(file.string(), "has no parts such as '" + part + "'; leave out what follows the colon");
  return read(file);
}

constexpr std::array formats = {
    Format{{"II*\0", 4}, whole<read_tiff>},
    Format{{"MM\0*", 4}, whole<read_tiff>},
    Format{{"II+\0", 4}, whole<read_tiff>},
    Format{{"MM\0+", 4}, whole<read_tiff>},
    Format{"\x89HDF\r\n\x1a\n", read_hdf5},
    Format{"SIMPLE  =", whole<read_fits>},
    Format{"\x93NUMPY", whole<read_npy>},
    Format{"PK\x03\x04", read_npz},
    Format{"Andor Technology Multi-Channel File", whole<read_sif>},
    Format{{"DCIMG\0", 6}, whole<read_dcimg>},
};

/// Nothing where the content is of no format that is known.
const Format* format_of(const Path& file) {
  std::array<char, 64> start{};
  File bytes(file, "rb");
  bytes.read(std::as_writable_bytes(std::span(start)));
  for (const Format& format : formats)
    if (std::string_view(start.data(), format.start.size()) == format.start) return &format;
  return nullptr;
}

std::unique_ptr<StackReader> open_file(const Path& file, const std::string& part) {
  if (fs::file_size(file) == 0) throw Error(file.string(), "the file is empty");
  const Format* format = format_of(file);
  if (!format)
    throw Error(file.string(),
                "its content is none of TIFF, HDF5, FITS, NumPy's .npy and .npz, Andor SIF, Hamamatsu DCIMG");
  return format->read(file, part);
}

/// "frame2" before "frame10": digits count as numbers.
bool natural_less(const std::string& a, const std::string& b) {
  const auto digit = [](char letter) { return letter >= '0' && letter <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      const auto number = [&](const std::string& text, std::size_t& at) {
        std::size_t end = at;
        while (end < text.size() && digit(text[end])) ++end;
        while (at + 1 < end && text[at] == '0') ++at;
        const std::string digits = text.substr(at, end - at);
        at = end;
        return digits;
      };
      const std::string left = number(a, i), right = number(b, j);
      if (left.size() != right.size()) return left.size() < right.size();
      if (left != right) return left < right;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
    }
  }
  return a.size() - i < b.size() - j || (a.size() - i == b.size() - j && a < b);
}

/// The frames of several files behind each other. One file is open at a time.
class FolderReader : public StackReader {
 public:
  FolderReader(const Path& place, std::vector<Path> files) : StackReader(place), files_(std::move(files)) {
    std::ranges::sort(files_, natural_less, [](const Path& file) { return file.filename().string(); });
    std::uint64_t frames = 0;
    StackShape first;
    PixelType type{};
    bool timed = true;
    for (std::size_t i = 0; i < files_.size(); ++i) {
      go(i);
      if (i == 0) {
        first = open_->shape();
        type = open_->type();
        metadata_ = open_->metadata();
        metadata_.timestamps_s.clear();
        notes_ = open_->notes();
      } else if (open_->shape().frame() != first.frame()) {
        throw Error(
            files_[i].string(),
            fmt::format("frame {}: {} x {} pixels, where {} has {} x {}", frames, open_->shape().rows,
                        open_->shape().columns, files_[0].filename().string(), first.rows, first.columns));
      } else if (open_->type() != type) {
        throw Error(files_[i].string(),
                    fmt::format("frame {}: {}, where {} is {}", frames, name_of(open_->type()),
                                files_[0].filename().string(), name_of(type)));
      }
      const auto& times = open_->metadata().timestamps_s;
      timed = timed && times.size() == open_->frames();
      if (timed) metadata_.timestamps_s.insert(metadata_.timestamps_s.end(), times.begin(), times.end());
      starts_.push_back(frames);
      frames += open_->frames();
    }
    if (!timed) metadata_.timestamps_s.clear();
    set_shape(frames, static_cast<std::uint64_t>(first.rows), static_cast<std::uint64_t>(first.columns),
              type);
  }

  std::string truth(std::uint64_t frame) override {
    if (frame >= frames()) fail(fmt::format("frame {} is not in it, it has {}", frame, frames()));
    const std::uint64_t within = find(frame);
    return open_->truth(within);
  }

 private:
  void go(std::size_t file) {
    if (open_ && file == current_) return;
    open_.reset();
    open_ = open_file(files_[file], {});
    current_ = file;
  }
  /// Opens the file that holds the frame; the frame's number in it.
  std::uint64_t find(std::uint64_t frame) {
    const auto next = std::ranges::upper_bound(starts_, frame);
    const auto file = static_cast<std::size_t>(next - starts_.begin()) - 1;
    go(file);
    return frame - starts_[file];
  }
  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    const std::uint64_t within = find(frame);
    if (open_->shape().frame() != shape_.frame() || open_->type() != type_ || within >= open_->frames())
      throw Error(open_->file().string(), fmt::format("frame {}: the file has changed", frame));
    open_->read_bytes(within, pixels);
  }

  std::vector<Path> files_;
  std::vector<std::uint64_t> starts_;  // number of each file's first frame
  std::unique_ptr<StackReader> open_;
  std::size_t current_ = 0;
};

bool is_image_name(const Path& file) {
  constexpr std::array known = {".tif", ".tiff", ".fits", ".fit", ".fts",  ".npy",
                                ".npz", ".h5",   ".hdf5", ".sif", ".dcimg"};
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  return std::ranges::find(known, extension) != known.end();
}

/// Files of a folder whose names match, without those that hide.
std::vector<Path> files_in(const Path& folder, const std::string& pattern) {
  std::vector<Path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_regular_file() || name.starts_with(".")) continue;
    if (pattern.empty() ? is_image_name(name) : fnmatch(pattern.c_str(), name.c_str(), 0) == 0)
      files.push_back(entry.path());
  }
  return files;
}

}  // namespace

std::unique_ptr<StackReader> open_stack(const Path& stack) {
  if (fs::is_directory(stack)) {
    auto files = files_in(stack, "");
    if (files.empty()) throw Error(stack.string(), "the folder holds no frames");
    return std::make_unique<FolderReader>(stack, std::move(files));
  }
  if (fs::exists(stack)) return open_file(stack, {});
  const std::string text = stack.string();
  if (const std::string name = stack.filename().string(); name.find_first_of("*?[") != name.npos) {
    const Path folder = stack.has_parent_path() ? stack.parent_path() : Path(".");
    if (fs::is_directory(folder))
      if (auto files = files_in(folder, name); !files.empty())
        return std::make_unique<FolderReader>(stack, std::move(files));
  }
  for (auto colon = text.find(':'); colon != text.npos; colon = text.find(':', colon + 1))
    if (const Path file = text.substr(0, colon); fs::is_regular_file(file))
      return open_file(file, text.substr(colon + 1));
  throw Error(text, "no such file");
}

}  // namespace atomcam
