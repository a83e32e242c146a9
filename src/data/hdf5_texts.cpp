#include "data/hdf5_texts.hpp"

#include <fmt/format.h>

namespace atomcam {
namespace {

constexpr std::uint64_t reference_bytes = 16;  // length (4), address of a heap (8), number in it (4)
constexpr std::uint64_t heap_header_bytes = 16, object_header_bytes = 16;

}  // namespace

Hdf5Texts::Hdf5Texts(const Path& file, hid_t hdf5)
    : name_(file), hdf5_(hdf5), file_(file, "rb"), size_(std::filesystem::file_size(file)) {
  const Hdf5Handle properties(H5Fget_create_plist(hdf5), H5Pclose);
  std::size_t addresses = 0, lengths = 0;
  hsize_t before = 0;
  known_ = properties >= 0 && H5Pget_sizes(properties, &addresses, &lengths) >= 0 &&
           H5Pget_userblock(properties, &before) >= 0 && addresses == 8 && lengths == 8 && before == 0;
}

bool Hdf5Texts::has(const char* dataset) const {
  if (!known_ || H5Lexists(hdf5_, dataset, H5P_DEFAULT) <= 0) return false;
  const Hdf5Handle set(H5Dopen2(hdf5_, dataset, H5P_DEFAULT), H5Dclose);
  if (set < 0) return false;
  const Hdf5Handle type(H5Dget_type(set), H5Tclose), space(H5Dget_space(set), H5Sclose),
      properties(H5Dget_create_plist(set), H5Pclose);
  if (type < 0 || space < 0 || properties < 0 || H5Tis_variable_str(type) <= 0) return false;
  const H5D_layout_t layout = H5Pget_layout(properties);
  const int axes = H5Sget_simple_extent_ndims(space);
  return axes >= 0 && axes <= 1 && H5Pget_nfilters(properties) == 0 &&
         (layout == H5D_CONTIGUOUS || layout == H5D_CHUNKED);
}

std::uint64_t Hdf5Texts::number(std::uint64_t at, std::size_t bytes) {
  std::byte little[8]{};
  file_.seek(static_cast<std::int64_t>(at));
  if (at > size_ || !file_.read(std::span(little).first(bytes)))
    throw Error(name_.string(), "a text is cut off");
  std::uint64_t value = 0;
  for (std::size_t i = bytes; i-- > 0;) value = value << 8 | std::to_integer<std::uint64_t>(little[i]);
  return value;
}

void Hdf5Texts::damaged(const char* dataset) const {
  throw Error(name_.string(), fmt::format("a text of '{}' is damaged", dataset));
}

std::string Hdf5Texts::read(const char* dataset, std::uint64_t index) {
  const Hdf5Handle set = hdf5_checked(name_, "read", H5Dopen2(hdf5_, dataset, H5P_DEFAULT), H5Dclose);
  const Hdf5Handle space = hdf5_checked(name_, "read", H5Dget_space(set), H5Sclose);
  const Hdf5Handle properties = hdf5_checked(name_, "read", H5Dget_create_plist(set), H5Pclose);
  hsize_t count = 1;
  if (H5Sget_simple_extent_ndims(space) == 1) H5Sget_simple_extent_dims(space, &count, nullptr);
  if (index >= count) return "";
  haddr_t at = HADDR_UNDEF;
  std::uint64_t within = index;
  if (H5Pget_layout(properties) == H5D_CHUNKED) {
    hsize_t chunk = 0, bytes = 0;
    if (H5Pget_chunk(properties, 1, &chunk) != 1 || chunk == 0) damaged(dataset);
    const hsize_t start = index / chunk * chunk;
    unsigned mask = 0;
    if (H5Dget_chunk_info_by_coord(set, &start, &mask, &at, &bytes) < 0 || bytes / reference_bytes < chunk)
      damaged(dataset);
    within = index - start;
  } else {
    at = H5Dget_offset(set);
  }
  if (at == HADDR_UNDEF || at > size_ || within > size_) return "";
  const std::uint64_t reference = at + within * reference_bytes;
  const std::uint64_t length = number(reference, 4), heap = number(reference + 4, 8),
                      object = number(reference + 12, 4);
  if (length == 0) return "";
  constexpr std::uint64_t signature = 0x4c4f4347;  // "GCOL"
  if (heap > size_ || size_ - heap < heap_header_bytes || number(heap, 4) != signature) damaged(dataset);
  const std::uint64_t heap_bytes = number(heap + 8, 8);
  if (heap_bytes > size_ - heap) damaged(dataset);
  for (std::uint64_t offset = heap_header_bytes; offset + object_header_bytes <= heap_bytes;) {
    const std::uint64_t id = number(heap + offset, 2), size = number(heap + offset + 8, 8);
    const std::uint64_t data = offset + object_header_bytes;
    if (id == 0 || size > heap_bytes - data) break;
    if (id == object) {
      if (length > size) break;
      std::string text(length, '\0');
      file_.seek(static_cast<std::int64_t>(heap + data));
      if (!file_.read(std::as_writable_bytes(std::span(text)))) break;
      return text.substr(0, text.find('\0'));
    }
    offset = data + (size + 7) / 8 * 8;
  }
  damaged(dataset);
}

}  // namespace atomcam
