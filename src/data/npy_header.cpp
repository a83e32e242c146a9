#include "data/npy_header.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>

#include "base/error.hpp"

namespace atomcam {
namespace {

/// The value behind 'key': in a header, up to `end`.
std::string_view value_of(const Path& place, std::string_view header, std::string_view key, char end) {
  const auto start = header.find(key);
  if (start == header.npos) throw Error(place.string(), "its header lacks " + std::string(key));
  const auto from = header.find_first_not_of(" :(", start + key.size());
  const auto to = header.find(end, from);
  if (from == header.npos || to == header.npos) throw Error(place.string(), "its header is not NumPy's");
  return header.substr(from, to - from);
}

struct Kind {
  std::string_view name;
  PixelType type;
};
constexpr std::array kinds = {
    Kind{"u1", PixelType::uint8},   Kind{"i1", PixelType::int8},    Kind{"b1", PixelType::uint8},
    Kind{"u2", PixelType::uint16},  Kind{"i2", PixelType::int16},   Kind{"u4", PixelType::uint32},
    Kind{"i4", PixelType::int32},   Kind{"u8", PixelType::uint64},  Kind{"i8", PixelType::int64},
    Kind{"f4", PixelType::float32}, Kind{"f8", PixelType::float64},
};

}  // namespace

NpyArray parse_npy(const Path& place, const std::function<bool(std::span<std::byte>)>& read) {
  std::array<std::byte, 12> start{};
  if (!read(std::span(start).first(8)) ||
      std::string_view(reinterpret_cast<const char*>(start.data()), 6) != "\x93NUMPY")
    throw Error(place.string(), "not an array of NumPy's format");
  const auto version = std::to_integer<unsigned>(start[6]);
  if (version < 1 || version > 3)
    throw Error(place.string(), fmt::format("NumPy's format {}; 1 to 3 can be read", version));
  const std::size_t length_bytes = version == 1 ? 2 : 4;
  if (!read(std::span(start).subspan(8, length_bytes))) throw Error(place.string(), "its header is cut off");
  std::size_t length = 0;
  for (std::size_t i = length_bytes; i-- > 0;)
    length = length << 8 | std::to_integer<std::size_t>(start[8 + i]);
  if (length > 65536) throw Error(place.string(), fmt::format("a header of {} bytes", length));
  std::string header(length, ' ');
  if (!read(std::as_writable_bytes(std::span(header)))) throw Error(place.string(), "its header is cut off");

  NpyArray array;
  array.data = 8 + length_bytes + length;
  std::string_view type = value_of(place, header, "'descr'", ',');
  if (type.size() < 5 || type.front() != '\'' || type.back() != '\'')
    throw Error(place.string(), "an array of type " + std::string(type));
  type = type.substr(1, type.size() - 2);
  const auto kind = std::ranges::find(kinds, type.substr(1), &Kind::name);
  if (kind == kinds.end() || std::string_view("<>|=").find(type[0]) == std::string_view::npos)
    throw Error(place.string(), "an array of type '" + std::string(type) +
                                    "'; integers of 8 to 64 bits and floating point of 32 or 64 can be read");
  array.type = kind->type;
  array.swapped =
      type[0] == (std::endian::native == std::endian::little ? '>' : '<') && bytes_of(array.type) > 1;
  if (const auto order = value_of(place, header, "'fortran_order'", ','); order != "False")
    throw Error(place.string(), "an array in Fortran's order; save numpy.ascontiguousarray of it");
  const std::string_view shape = value_of(place, header, "'shape'", ')');
  std::vector<std::uint64_t> sizes;
  for (const char* at = shape.data(); at < shape.data() + shape.size();) {
    if (*at == ' ' || *at == ',') {
      ++at;
      continue;
    }
    const auto [end, problem] = std::from_chars(at, shape.data() + shape.size(), sizes.emplace_back());
    if (problem != std::errc{}) throw Error(place.string(), "its shape is (" + std::string(shape) + ")");
    at = end;
  }
  if (sizes.size() < 2 || sizes.size() > 3)
    throw Error(place.string(), "its shape (" + std::string(shape) + ") is not frames, rows, columns");
  if (sizes.size() == 2) sizes.insert(sizes.begin(), 1);
  array.frames = sizes[0], array.rows = sizes[1], array.columns = sizes[2];
  return array;
}

void NpyArray::check_size(const Path& place, std::uint64_t size) const {
  const std::uint64_t frame = rows * columns * bytes_of(type);
  const std::uint64_t held = size > data ? (size - data) / frame : 0;
  if (held < frames)
    throw Error(
        place.string(),
        fmt::format("frame {}: the file ends in it, its header announces {}; cut off?", held, frames));
  if (size != data + frames * frame)
    throw Error(place.string(), fmt::format("{} bytes follow the {} frames that its header announces",
                                            size - data - frames * frame, frames));
}

void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value) {
  for (std::size_t i = 0; i + bytes_per_value <= values.size(); i += bytes_per_value)
    std::ranges::reverse(values.subspan(i, bytes_per_value));
}

}  // namespace atomcam
