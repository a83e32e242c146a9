#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "data/hdf5_texts.hpp"

namespace atomcam {
namespace {

constexpr hsize_t most_chunk_bytes = hsize_t{1} << 30;
constexpr std::size_t most_text_bytes = 1 << 20;

struct Kind {
  H5T_class_t kind;
  std::size_t bytes;
  H5T_sign_t sign;
  PixelType type;
};
constexpr Kind kinds[] = {
    {H5T_INTEGER, 1, H5T_SGN_NONE, PixelType::uint8},  {H5T_INTEGER, 1, H5T_SGN_2, PixelType::int8},
    {H5T_INTEGER, 2, H5T_SGN_NONE, PixelType::uint16}, {H5T_INTEGER, 2, H5T_SGN_2, PixelType::int16},
    {H5T_INTEGER, 4, H5T_SGN_NONE, PixelType::uint32}, {H5T_INTEGER, 4, H5T_SGN_2, PixelType::int32},
    {H5T_INTEGER, 8, H5T_SGN_NONE, PixelType::uint64}, {H5T_INTEGER, 8, H5T_SGN_2, PixelType::int64},
    {H5T_FLOAT, 4, H5T_SGN_ERROR, PixelType::float32}, {H5T_FLOAT, 8, H5T_SGN_ERROR, PixelType::float64},
};

hid_t in_memory(PixelType type) {
  switch (type) {
    case PixelType::uint8:
      return H5T_NATIVE_UINT8;
    case PixelType::int8:
      return H5T_NATIVE_INT8;
    case PixelType::uint16:
      return H5T_NATIVE_UINT16;
    case PixelType::int16:
      return H5T_NATIVE_INT16;
    case PixelType::uint32:
      return H5T_NATIVE_UINT32;
    case PixelType::int32:
      return H5T_NATIVE_INT32;
    case PixelType::uint64:
      return H5T_NATIVE_UINT64;
    case PixelType::int64:
      return H5T_NATIVE_INT64;
    case PixelType::float32:
      return H5T_NATIVE_FLOAT;
    case PixelType::float64:
      return H5T_NATIVE_DOUBLE;
  }
  return -1;
}

/// Frames are the last two axes of a dataset; the axes before count them, the last of those fastest.
class Hdf5StackReader : public StackReader {
 public:
  Hdf5StackReader(const Path& file, const std::string& path) : StackReader(file) {
    keep_hdf5_quiet();
    errno = 0;
    hdf5_ = made(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    const std::string name = path.empty() ? only_dataset() : path;
    if (!path.empty()) check_path(path);
    pixels_ = made(H5Dopen2(hdf5_, name.c_str(), H5P_DEFAULT), H5Dclose);
    read_shape(name);
    read_attributes();
    texts_.emplace(file, hdf5_);
    has_truth_ = texts_->has("truth");
    StackNotes notes;
    for (const auto& [key, text] : {std::pair("lab", &notes.lab), std::pair("settings", &notes.settings)})
      if (texts_->has(key)) *text = texts_->read(key, 0);
    set_notes(std::move(notes));
  }
  std::string truth(std::uint64_t frame) override {
    const std::string text = has_truth_ && frame < frames() ? texts_->read("truth", frame) : "";
    return text.empty() ? "null" : text;
  }

 private:
  Hdf5Handle made(hid_t id, herr_t (*close)(hid_t)) const { return hdf5_checked(file_, "read", id, close); }
  void check(herr_t status) const {
    if (status < 0) fail(cannot("read", errno, hdf5_complaint()));
  }

  /// "frames", or the only dataset of two or more axes of numbers.
  std::string only_dataset() {
    if (H5Lexists(hdf5_, "frames", H5P_DEFAULT) > 0) return "frames";
    std::vector<std::string> names;
    const auto take = [](hid_t root, const char* name, const H5O_info_t* info, void* found) -> herr_t {
      if (info->type != H5O_TYPE_DATASET) return 0;
      const Hdf5Handle set(H5Dopen2(root, name, H5P_DEFAULT), H5Dclose);
      if (set < 0) return 0;
      const Hdf5Handle space(H5Dget_space(set), H5Sclose), type(H5Dget_type(set), H5Tclose);
      if (space < 0 || type < 0 || H5Sget_simple_extent_ndims(space) < 2) return 0;
      const H5T_class_t kind = H5Tget_class(type);
      if (kind == H5T_INTEGER || kind == H5T_FLOAT)
        static_cast<std::vector<std::string>*>(found)->push_back(name);
      return 0;
    };
    check(H5Ovisit2(hdf5_, H5_INDEX_NAME, H5_ITER_NATIVE, take, &names, H5O_INFO_BASIC));
    if (names.empty()) fail("it holds no dataset of frames");
    if (names.size() > 1) {
      std::string list;
      for (std::size_t i = 0; i < std::min<std::size_t>(names.size(), 8); ++i)
        list += (i ? ", /" : "/") + names[i];
      fail(fmt::format("it holds {} datasets that could be frames: {}{}; choose one, as in {}:/{}",
                       names.size(), list, names.size() > 8 ? ", ..." : "", file_.string(), names.front()));
    }
    return names.front();
  }

  /// Step by step: H5Lexists wants every group on the way.
  void check_path(const std::string& path) const {
    for (std::size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
      const std::string part = path.substr(0, end);
      if (part != "/" && H5Lexists(hdf5_, part.c_str(), H5P_DEFAULT) <= 0) fail("no dataset '" + path + "'");
      if (end == path.npos) return;
    }
  }

  void read_shape(const std::string& name) {
    const Hdf5Handle space = made(H5Dget_space(pixels_), H5Sclose);
    const int axes = H5Sget_simple_extent_ndims(space);
    if (axes < 2 || axes > 8) fail(fmt::format("dataset '{}' has {} axes; frames need 2 to 8", name, axes));
    sizes_.resize(static_cast<std::size_t>(axes));
    check(H5Sget_simple_extent_dims(space, sizes_.data(), nullptr));
    const Hdf5Handle type = made(H5Dget_type(pixels_), H5Tclose);
    const H5T_class_t kind = H5Tget_class(type);
    const H5T_sign_t sign = kind == H5T_INTEGER ? H5Tget_sign(type) : H5T_SGN_ERROR;
    const std::size_t bytes = H5Tget_size(type);
    const auto found = std::ranges::find_if(
        kinds, [&](const Kind& k) { return k.kind == kind && k.bytes == bytes && k.sign == sign; });
    if (found == std::end(kinds))
      fail(
          fmt::format("dataset '{}' is not of integers of 8 to 64 bits or floating point of 32 or 64", name));
    std::uint64_t frames = 1;
    for (std::size_t i = 0; i + 2 < sizes_.size(); ++i) {
      if (sizes_[i] > (std::uint64_t{1} << 40) || frames > (std::uint64_t{1} << 40))
        fail(fmt::format("dataset '{}' with an axis of {}", name, sizes_[i]));
      frames *= sizes_[i];
    }
    set_shape(frames, sizes_[sizes_.size() - 2], sizes_.back(), found->type);
    check_storage(name);
  }

  /// What a damaged or cut off file announces and does not hold reads as zeros.
  void check_storage(const std::string& name) {
    const Hdf5Handle properties = made(H5Dget_create_plist(pixels_), H5Pclose);
    const std::uint64_t file_size = std::filesystem::file_size(file_);
    const std::uint64_t frame_bytes = shape_.pixels() * bytes_of(type_);
    for (int i = 0; i < H5Pget_nfilters(properties); ++i) {
      unsigned flags = 0;
      std::size_t values = 0;
      char filter[64] = "";
      const H5Z_filter_t id = H5Pget_filter2(properties, static_cast<unsigned>(i), &flags, &values, nullptr,
                                             sizeof filter, filter, nullptr);
      if (H5Zfilter_avail(id) <= 0)
        fail(fmt::format("dataset '{}' is compressed by filter {} ({}), which is not at hand", name,
                         static_cast<int>(id), filter));
    }
    switch (H5Pget_layout(properties)) {
      case H5D_CONTIGUOUS: {
        const haddr_t at = H5Dget_offset(pixels_);
        const std::uint64_t held = at == HADDR_UNDEF || at > file_size ? 0 : (file_size - at) / frame_bytes;
        if (held < frames())
          fail(held, fmt::format("the file ends in it, dataset '{}' announces {}; cut off?", name, frames()));
        if (H5Dget_storage_size(pixels_) != frames() * frame_bytes)
          fail(fmt::format("dataset '{}' is stored in {} bytes and needs {}", name,
                           H5Dget_storage_size(pixels_), frames() * frame_bytes));
        return;
      }
      case H5D_CHUNKED: {
        std::vector<hsize_t> chunk(sizes_.size());
        if (H5Pget_chunk(properties, static_cast<int>(chunk.size()), chunk.data()) !=
            static_cast<int>(chunk.size()))
          fail(fmt::format("dataset '{}' has chunks of other axes", name));
        hsize_t bytes = bytes_of(type_), needed = 1, stored = 0;
        for (std::size_t i = 0; i < chunk.size(); ++i) {
          if (chunk[i] == 0 || bytes > most_chunk_bytes || chunk[i] > most_chunk_bytes)
            fail(fmt::format("dataset '{}' has chunks of {} along axis {}", name, chunk[i], i));
          bytes *= chunk[i];
          needed *= (sizes_[i] + chunk[i] - 1) / chunk[i];
        }
        if (bytes > most_chunk_bytes) fail(fmt::format("dataset '{}' has chunks of {} bytes", name, bytes));
        const Hdf5Handle space = made(H5Dget_space(pixels_), H5Sclose);
        check(H5Dget_num_chunks(pixels_, space, &stored));
        if (stored != needed)
          fail(fmt::format("dataset '{}' needs {} chunks and holds {}; cut off?", name, needed, stored));
        return;
      }
      default:
        return;
    }
  }

  /// Numbers and texts beside the dataset.
  void read_attributes() {
    const auto take = [](hid_t set, const char* name, const H5A_info_t* info, void* self) -> herr_t {
      if (info->data_size > most_text_bytes) return 0;
      const Hdf5Handle attribute(H5Aopen(set, name, H5P_DEFAULT), H5Aclose);
      if (attribute < 0) return 0;
      const Hdf5Handle space(H5Aget_space(attribute), H5Sclose), type(H5Aget_type(attribute), H5Tclose);
      if (space < 0 || type < 0 || H5Sget_simple_extent_npoints(space) != 1) return 0;
      auto& others = static_cast<Hdf5StackReader*>(self)->metadata_.others;
      const H5T_class_t kind = H5Tget_class(type);
      if (kind == H5T_INTEGER || kind == H5T_FLOAT) {
        double value = 0;
        if (H5Aread(attribute, H5T_NATIVE_DOUBLE, &value) >= 0) others[name] = fmt::format("{}", value);
      } else if (kind == H5T_STRING && H5Tis_variable_str(type) <= 0) {
        std::string text(H5Tget_size(type), '\0');
        if (H5Aread(attribute, type, text.data()) >= 0) others[name] = text.c_str();
      }
      return 0;
    };
    check(H5Aiterate2(pixels_, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, take, this));
    const auto number = [&](std::initializer_list<const char*> names, std::optional<double>& field) {
      for (const char* name : names)
        if (const auto found = metadata_.others.find(name); found != metadata_.others.end() && !field)
          field = std::atof(found->second.c_str());
    };
    number({"exposure_s", "exposure_time", "exposure"}, metadata_.exposure_s);
    number({"em_gain"}, metadata_.em_gain);
    number({"bias_counts"}, metadata_.bias_counts);
    number({"electrons_per_count"}, metadata_.electrons_per_count);
    if (const auto camera = metadata_.others.find("camera"); camera != metadata_.others.end())
      metadata_.camera = camera->second;
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    std::vector<hsize_t> start(sizes_.size(), 0), count(sizes_.size(), 1);
    std::uint64_t left = frame;
    for (std::size_t i = sizes_.size() - 2; i-- > 0;) {
      start[i] = left % sizes_[i];
      left /= sizes_[i];
    }
    count[count.size() - 2] = sizes_[sizes_.size() - 2];
    count.back() = sizes_.back();
    errno = 0;
    const Hdf5Handle space = made(H5Dget_space(pixels_), H5Sclose);
    check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr));
    const Hdf5Handle memory =
        made(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    if (H5Dread(pixels_, in_memory(type_), memory, space, H5P_DEFAULT, pixels.data()) < 0)
      fail(frame, cannot("read", errno, hdf5_complaint()));
  }

  Hdf5Handle hdf5_, pixels_;
  std::optional<Hdf5Texts> texts_;
  std::vector<hsize_t> sizes_;
  bool has_truth_ = false;
};

}  // namespace

std::unique_ptr<StackReader> read_hdf5(const Path& file, const std::string& path) {
  return std::make_unique<Hdf5StackReader>(file, path);
}

}  // namespace atomcam
