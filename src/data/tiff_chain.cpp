#include "data/tiff_chain.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <unordered_set>

#include "base/error.hpp"
#include "data/file.hpp"

namespace atomcam {
namespace {

// Bytes of a value of TIFF's field types 0 to 18 (TIFF 6.0, and 16 to 18 of BigTIFF).
constexpr std::array<std::uint64_t, 19> type_bytes = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4,
                                                      8, 4, 8, 4, 0, 0, 8, 8, 8};

class Walker {
 public:
  explicit Walker(const std::filesystem::path& file) : name_(file), file_(file, "rb") {
    file_.seek(0, SEEK_END);
    chain_.file_size = static_cast<std::uint64_t>(file_.position());
  }

  TiffChain walk() {
    file_.seek(0);
    std::array<std::byte, 16> head{};
    if (!file_.read(std::span(head).first(8))) throw Error(name_.string(), "cut off in its header");
    chain_.big_endian = head[0] == std::byte{'M'};
    big_ = number(std::span(head).subspan(2, 2)) == 43;
    if (big_ && !file_.read(std::span(head).subspan(8))) throw Error(name_.string(), "cut off in its header");
    std::uint64_t offset =
        big_ ? number(std::span(head).subspan(8, 8)) : number(std::span(head).subspan(4, 4));
    std::unordered_set<std::uint64_t> seen;
    while (offset != 0) {
      const std::size_t page = chain_.offsets.size();
      if (!seen.insert(offset).second)
        throw Error(name_.string(), fmt::format("frame {}: its directory is that of an earlier page", page));
      chain_.offsets.push_back(offset);
      offset = directory(offset, page);
    }
    if (chain_.offsets.empty()) throw Error(name_.string(), "a TIFF without pages");
    return std::move(chain_);
  }

 private:
  std::uint64_t number(std::span<const std::byte> bytes) const {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
      value =
          value << 8 | std::to_integer<std::uint64_t>(bytes[chain_.big_endian ? i : bytes.size() - 1 - i]);
    return value;
  }

  /// Returns the offset of the next one.
  std::uint64_t directory(std::uint64_t offset, std::size_t page) {
    const std::uint64_t count_bytes = big_ ? 8 : 2, entry_bytes = big_ ? 20 : 12, word = big_ ? 8 : 4;
    const auto cut = [&]() -> Error {
      return Error(name_.string(),
                   fmt::format("frame {}: its directory lies beyond the end of the file; cut off?", page));
    };
    if (offset > chain_.file_size) throw cut();
    std::array<std::byte, 8> start{};
    file_.seek(static_cast<std::int64_t>(offset));
    if (!file_.read(std::span(start).first(count_bytes))) throw cut();
    const std::uint64_t entries = number(std::span(start).first(count_bytes));
    if (entries == 0 || entries > 65535)
      throw Error(name_.string(), fmt::format("frame {}: a directory of {} entries", page, entries));
    const std::uint64_t size = entries * entry_bytes + word;
    if (offset + count_bytes + size > chain_.file_size) throw cut();
    bytes_.resize(size);
    if (!file_.read(bytes_)) throw cut();
    chain_.end = std::max(chain_.end, offset + count_bytes + size);
    for (std::uint64_t i = 0; i < entries; ++i) {
      const auto entry = std::span(bytes_).subspan(i * entry_bytes, entry_bytes);
      const std::uint64_t type = number(entry.subspan(2, 2));
      const std::uint64_t values = number(entry.subspan(4, word));
      const std::uint64_t width = type < type_bytes.size() ? type_bytes[type] : 0;
      if (width == 0 || values * width <= word) continue;
      const std::uint64_t at = number(entry.subspan(4 + word, word));
      if (at > chain_.file_size || values > chain_.file_size || values * width > chain_.file_size - at)
        throw Error(name_.string(), fmt::format("frame {}: tag {} lies beyond the end of the file; cut off?",
                                                page, number(entry.first(2))));
      chain_.end = std::max(chain_.end, at + values * width);
    }
    return number(std::span(bytes_).last(word));
  }

  std::filesystem::path name_;
  File file_;
  TiffChain chain_;
  bool big_ = false;
  std::vector<std::byte> bytes_;
};

}  // namespace

TiffChain tiff_chain(const std::filesystem::path& file) {
  return Walker(file).walk();
}

}  // namespace atomcam
