#pragma once
// A FITS file of CFITSIO whose every failure is an Error that names it.

#include <fitsio.h>

#include <cerrno>
#include <utility>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {

/// Every call's status goes through `check`.
class Fits {
 public:
  explicit Fits(Path file) : file_(std::move(file)) { fits_clear_errmsg(); }
  ~Fits() {
    int ignored = 0;
    if (handle_) fits_close_file(handle_, &ignored);
  }
  Fits(const Fits&) = delete;
  Fits& operator=(const Fits&) = delete;

  void check(const char* verb) {
    if (status_ == 0) return;
    const int system = errno;
    char message[FLEN_ERRMSG] = "";
    fits_get_errstatus(status_, message);
    fits_clear_errmsg();
    status_ = 0;
    throw Error(file_.string(), cannot(verb, system, message));
  }
  void close(const char* verb) {
    if (!handle_) return;
    errno = 0;
    fits_close_file(std::exchange(handle_, nullptr), &status_);
    check(verb);
  }
  fitsfile** address() { return &handle_; }
  operator fitsfile*() const { return handle_; }
  const Path& file() const { return file_; }
  int* status() { return &status_; }

 private:
  Path file_;
  fitsfile* handle_ = nullptr;
  int status_ = 0;
};

}  // namespace atomcam
