#include "data/hdf5_handle.hpp"

namespace atomcam {
namespace {

class Hdf5StackWriter : public StackWriter {
 public:
  Hdf5StackWriter(const Path& file, Shape shape, const StackNotes& notes) : StackWriter(file, shape) {
    keep_hdf5_quiet();
    errno = 0;
    // From 1.8 on headers have checksums: without them a damaged one can tell another shape.
    const Hdf5Handle access = made(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    check(H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST));
    hdf5_ = made(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose);
    text_ = hdf5_text_type(file);
    const hsize_t rows = static_cast<hsize_t>(shape.rows), columns = static_cast<hsize_t>(shape.columns);
    pixels_ = growing("frames", H5T_STD_U16LE, {0, rows, columns}, {1, rows, columns});
    truth_ = growing("truth", text_, {0}, {64});
    write_text("lab", notes.lab);
    write_text("settings", notes.settings);
  }
  void finish() override {
    errno = 0;
    const bool closed = pixels_.reset() & truth_.reset() & text_.reset();
    if (!(hdf5_.reset() && closed)) throw Error(file_.string(), cannot("written", errno, hdf5_complaint()));
  }

 private:
  Hdf5Handle made(hid_t id, herr_t (*close)(hid_t)) const {
    return hdf5_checked(file_, "written", id, close);
  }
  void check(herr_t status) const {
    if (status < 0) throw Error(file_.string(), cannot("written", errno, hdf5_complaint()));
  }

  Hdf5Handle growing(const char* name, hid_t type, std::vector<hsize_t> size,
                     const std::vector<hsize_t>& chunk) {
    std::vector<hsize_t> limit = size;
    limit[0] = H5S_UNLIMITED;
    const auto rank = static_cast<int>(size.size());
    const Hdf5Handle space = made(H5Screate_simple(rank, size.data(), limit.data()), H5Sclose);
    const Hdf5Handle properties = made(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    check(H5Pset_chunk(properties, rank, chunk.data()));
    return made(H5Dcreate2(hdf5_, name, type, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose);
  }
  void write_text(const char* name, const std::string& text) {
    const Hdf5Handle space = made(H5Screate(H5S_SCALAR), H5Sclose);
    const Hdf5Handle set =
        made(H5Dcreate2(hdf5_, name, text_, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose);
    const char* value = text.c_str();
    check(H5Dwrite(set, text_, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
  }
  /// Writes element `frames_` along the first axis of a dataset.
  void extend(const Hdf5Handle& set, std::vector<hsize_t> size, hid_t type, const void* data) {
    std::vector<hsize_t> start(size.size(), 0), count = size;
    start[0] = frames_;
    count[0] = 1;
    size[0] = frames_ + 1;
    check(H5Dset_extent(set, size.data()));
    const Hdf5Handle space = made(H5Dget_space(set), H5Sclose);
    check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr));
    const Hdf5Handle memory =
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

  Hdf5Handle hdf5_, text_, pixels_, truth_;  // the file is closed last
};

}  // namespace

std::unique_ptr<StackWriter> write_hdf5(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t) {
  return std::make_unique<Hdf5StackWriter>(file, shape, notes);
}

}  // namespace atomcam
