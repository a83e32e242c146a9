#include <fmt/format.h>
#include <zip.h>

#include <algorithm>

#include "base/error.hpp"
#include "data/npy_header.hpp"

namespace atomcam {
namespace {

class NpzStackReader : public StackReader {
 public:
  NpzStackReader(const Path& file, const std::string& name) : StackReader(file) {
    int problem = 0;
    zip_.reset(zip_open(file.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, &problem));
    if (!zip_) {
      zip_error_t error;
      zip_error_init_with_code(&error, problem);
      const std::string text = zip_error_strerror(&error);
      zip_error_fini(&error);
      fail("cannot be read (" + text + ")");
    }
    choose(name);
    zip_stat_t facts;
    if (zip_stat_index(zip_.get(), entry_, 0, &facts) != 0) fail(zip_strerror(zip_.get()));
    rewind();
    array_ = parse_npy(place(), [&](std::span<std::byte> bytes) { return take(bytes); });
    set_shape(array_.frames, array_.rows, array_.columns, array_.type);
    array_.check_size(place(), facts.size);
    // Deflate makes a thousandth of its input at best.
    if (facts.size / 2048 > facts.comp_size) fail("an array larger than its bytes can hold");
    seekable_ = facts.comp_method == ZIP_CM_STORE;
  }

 private:
  struct Close {
    void operator()(zip_t* zip) const { zip_discard(zip); }
    void operator()(zip_file_t* file) const { zip_fclose(file); }
  };

  Path place() const { return file_.string() + ":" + array_name_; }

  /// The array named, or "frames", or the only one that could hold frames.
  void choose(const std::string& name) {
    std::vector<std::string> arrays;
    std::vector<zip_uint64_t> entries;
    const zip_int64_t count = zip_get_num_entries(zip_.get(), 0);
    for (zip_int64_t i = 0; i < count; ++i) {
      const char* entry = zip_get_name(zip_.get(), static_cast<zip_uint64_t>(i), 0);
      std::string text = entry ? entry : "";
      if (!text.ends_with(".npy")) continue;
      text.resize(text.size() - 4);
      arrays.push_back(text);
      entries.push_back(static_cast<zip_uint64_t>(i));
    }
    auto chosen = std::ranges::find(arrays, name.empty() ? "frames" : name);
    if (chosen == arrays.end() && name.empty() && arrays.size() == 1) chosen = arrays.begin();
    if (chosen == arrays.end())
      fail(fmt::format("{}; it holds the arrays {} (choose one: {}:NAME)",
                       name.empty() ? "which array?" : "no array '" + name + "'", fmt::join(arrays, ", "),
                       file_.string()));
    array_name_ = *chosen;
    entry_ = entries[static_cast<std::size_t>(chosen - arrays.begin())];
  }

  void rewind() {
    stream_.reset(zip_fopen_index(zip_.get(), entry_, 0));
    if (!stream_) fail(zip_strerror(zip_.get()));
    position_ = 0;
  }
  bool take(std::span<std::byte> bytes) {
    while (!bytes.empty()) {
      const zip_int64_t got = zip_fread(stream_.get(), bytes.data(), bytes.size());
      if (got <= 0) return false;
      position_ += static_cast<std::uint64_t>(got);
      bytes = bytes.subspan(static_cast<std::size_t>(got));
    }
    return true;
  }
  /// Compressed bytes can only be gone through from the start.
  bool go(std::uint64_t position) {
    if (position == position_) return true;
    if (seekable_) {
      if (position < position_) rewind();
      if (zip_fseek(stream_.get(), static_cast<zip_int64_t>(position), SEEK_SET) != 0) return false;
      position_ = position;
      return true;
    }
    if (position < position_) rewind();
    std::vector<std::byte> skipped(std::min<std::uint64_t>(position - position_, 1 << 16));
    while (position_ < position)
      if (!take(std::span(skipped).first(std::min<std::uint64_t>(skipped.size(), position - position_))))
        return false;
    return true;
  }
  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    if (!go(array_.data + frame * pixels.size()) || !take(pixels)) {
      const std::string text = zip_file_strerror(stream_.get());
      rewind();
      throw Error(place().string(), fmt::format("frame {}: cannot be read ({})", frame, text));
    }
    if (array_.swapped) swap_bytes(pixels, bytes_of(type_));
  }

  std::unique_ptr<zip_t, Close> zip_;
  std::unique_ptr<zip_file_t, Close> stream_;
  zip_uint64_t entry_ = 0;
  std::string array_name_;
  NpyArray array_;
  std::uint64_t position_ = 0;
  bool seekable_ = false;
};

}  // namespace

std::unique_ptr<StackReader> read_npz(const Path& file, const std::string& name) {
  return std::make_unique<NpzStackReader>(file, name);
}

}  // namespace atomcam
