#pragma once
// Identifiers of HDF5 that close themselves, and its complaints.

#include <hdf5.h>

#include <cerrno>
#include <utility>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {

/// An HDF5 identifier with the function that closes it.
class Hdf5Handle {
 public:
  Hdf5Handle() = default;
  Hdf5Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Hdf5Handle() { reset(); }
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
inline void keep_hdf5_quiet() {
  H5dont_atexit();  // everything is closed before; after a failed write the cleaning up at exit crashes
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

inline std::string hdf5_complaint() {
  std::string text;
  const auto take = [](unsigned, const H5E_error2_t* error, void* data) -> herr_t {
    if (error->desc) *static_cast<std::string*>(data) = error->desc;
    return 1;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take, &text);
  return text;
}

inline Hdf5Handle hdf5_checked(const Path& file, const char* verb, hid_t id, herr_t (*close)(hid_t)) {
  if (id < 0) throw Error(file.string(), cannot(verb, errno, hdf5_complaint()));
  return Hdf5Handle(id, close);
}

inline Hdf5Handle hdf5_text_type(const Path& file) {
  Hdf5Handle type = hdf5_checked(file, "written", H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

}  // namespace atomcam
