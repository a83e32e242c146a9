#include <hdf5.h>

#include <cerrno>
#include <utility>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

/// An HDF5 identifier with the function that closes it.
class Handle {
 public:
  Handle() = default;
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() { reset(); }
  bool reset() {
    const hid_t id = std::exchange(id_, -1);
    return id < 0 || close_(id) >= 0;
  }
  operator hid_t() const { return id_; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

/// The library prints its errors unless told otherwise; here they become an Error.
void keep_quiet() {
  H5dont_atexit();  // everything is closed before; after a failed write the cleaning up at exit crashes
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

std::string innermost_complaint() {
  std::string text;
  const auto take = [](unsigned, const H5E_error2_t* error, void* data) -> herr_t {
    if (error->desc) *static_cast<std::string*>(data) = error->desc;
    return 1;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take, &text);
  return text;
}

Handle checked(const Path& file, const char* verb, hid_t id, herr_t (*close)(hid_t)) {
  if (id < 0) throw Error(file.string(), cannot(verb, errno, innermost_complaint()));
  return Handle(id, close);
}

Handle text_type(const Path& file) {
  Handle type = checked(file, "written", H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

class Hdf5StackWriter : public StackWriter {
 public:
  Hdf5StackWriter(const Path& file, Shape shape, const StackNotes& notes) : StackWriter(file, shape) {
    keep_quiet();
    errno = 0;
    hdf5_ = made(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    text_ = text_type(file);
    const hsize_t rows = static_cast<hsize_t>(shape.rows), columns = static_cast<hsize_t>(shape.columns);
    pixels_ = growing("frames", H5T_STD_U16LE, {0, rows, columns}, {1, rows, columns});
    truth_ = growing("truth", text_, {0}, {64});
    write_text("lab", notes.lab);
    write_text("settings", notes.settings);
  }
  void finish() override {
    errno = 0;
    const bool closed = pixels_.reset() & truth_.reset() & text_.reset();
    if (!(hdf5_.reset() && closed))
      throw Error(file_.string(), cannot("written", errno, innermost_complaint()));
  }

 private:
  Handle made(hid_t id, herr_t (*close)(hid_t)) const { return checked(file_, "written", id, close); }
  void check(herr_t status) const {
    if (status < 0) throw Error(file_.string(), cannot("written", errno, innermost_complaint()));
  }

  Handle growing(const char* name, hid_t type, std::vector<hsize_t> size, const std::vector<hsize_t>& chunk) {
    std::vector<hsize_t> limit = size;
    limit[0] = H5S_UNLIMITED;
    const auto rank = static_cast<int>(size.size());
    const Handle space = made(H5Screate_simple(rank, size.data(), limit.data()), H5Sclose);
    const Handle properties = made(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    check(H5Pset_chunk(properties, rank, chunk.data()));
    return made(H5Dcreate2(hdf5_, name, type, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose);
  }
  void write_text(const char* name, const std::string& text) {
    const Handle space = made(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle set =
        made(H5Dcreate2(hdf5_, name, text_, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose);
    const char* value = text.c_str();
    check(H5Dwrite(set, text_, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
  }
  /// Writes element `frames_` along the first axis of a dataset.
  void extend(const Handle& set, std::vector<hsize_t> size, hid_t type, const void* data) {
    std::vector<hsize_t> start(size.size(), 0), count = size;
    start[0] = frames_;
    count[0] = 1;
    size[0] = frames_ + 1;
    check(H5Dset_extent(set, size.data()));
    const Handle space = made(H5Dget_space(set), H5Sclose);
    check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr));
    const Handle memory =
        made(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    check(H5Dwrite(set, type, memory, space, H5P_DEFAULT, data));
  }
  void write(const CountImage& frame, const std::string& truth) override {
    errno = 0;
    extend(pixels_, {0, static_cast<hsize_t>(shape_.rows), static_cast<hsize_t>(shape_.columns)},
           H5T_NATIVE_UINT16, frame.pixels().data());
    const char* text = truth.c_str();
    extend(truth_, {0}, text_, &text);
    check(H5Fflush(hdf5_, H5F_SCOPE_LOCAL));  // readable up to here whatever happens to this process
  }

  Handle hdf5_, text_, pixels_, truth_;  // the file is closed last
};

class Hdf5StackReader : public StackReader {
 public:
  explicit Hdf5StackReader(const Path& file) : StackReader(file) {
    keep_quiet();
    errno = 0;
    hdf5_ = made(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    text_ = text_type(file);
    pixels_ = made(H5Dopen2(hdf5_, "frames", H5P_DEFAULT), H5Dclose);
    const Handle space = made(H5Dget_space(pixels_), H5Sclose);
    hsize_t size[3] = {};
    if (H5Sget_simple_extent_ndims(space) != 3) throw Error(file.string(), "'frames' has not three axes");
    H5Sget_simple_extent_dims(space, size, nullptr);
    set_shape(size[0], size[1], size[2], PixelType::uint16);
    has_truth_ = H5Lexists(hdf5_, "truth", H5P_DEFAULT) > 0;
    StackNotes notes;
    for (const auto& [name, text] : {std::pair("lab", &notes.lab), std::pair("settings", &notes.settings)})
      if (H5Lexists(hdf5_, name, H5P_DEFAULT) > 0) *text = read_text(name, nullptr);
    set_notes(std::move(notes));
  }
  std::string truth(std::uint64_t frame) override {
    const hsize_t start = frame;
    return has_truth_ && frame < frames() ? read_text("truth", &start) : "null";
  }

 private:
  Handle made(hid_t id, herr_t (*close)(hid_t)) const { return checked(file_, "read", id, close); }
  void check(herr_t status) const {
    if (status < 0) throw Error(file_.string(), cannot("read", errno, innermost_complaint()));
  }
  /// A scalar text, or element `start` of a list of texts.
  std::string read_text(const char* name, const hsize_t* start) const {
    const Handle set = made(H5Dopen2(hdf5_, name, H5P_DEFAULT), H5Dclose);
    const Handle space = made(H5Dget_space(set), H5Sclose);
    const hsize_t one = 1;
    if (start) H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, &one, nullptr);
    const Handle memory = made(start ? H5Screate_simple(1, &one, nullptr) : H5Screate(H5S_SCALAR), H5Sclose);
    char* value = nullptr;
    check(H5Dread(set, text_, memory, space, H5P_DEFAULT, &value));
    const std::string text = value ? value : "";
    H5Dvlen_reclaim(text_, memory, H5P_DEFAULT, &value);
    return text;
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    const hsize_t start[3] = {frame, 0, 0};
    const hsize_t count[3] = {1, static_cast<hsize_t>(shape_.rows), static_cast<hsize_t>(shape_.columns)};
    const Handle space = made(H5Dget_space(pixels_), H5Sclose);
    H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, count, nullptr);
    const Handle memory = made(H5Screate_simple(3, count, nullptr), H5Sclose);
    check(H5Dread(pixels_, H5T_NATIVE_UINT16, memory, space, H5P_DEFAULT, pixels.data()));
  }

  Handle hdf5_, text_, pixels_;
  bool has_truth_ = false;
};

}  // namespace

std::unique_ptr<StackWriter> write_hdf5(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t) {
  return std::make_unique<Hdf5StackWriter>(file, shape, notes);
}

std::unique_ptr<StackReader> read_hdf5(const Path& file) {
  return std::make_unique<Hdf5StackReader>(file);
}

}  // namespace atomcam
