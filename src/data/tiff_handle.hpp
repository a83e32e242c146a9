#pragma once
// A TIFF file whose every failure is an Error that names it.

#include <tiffio.h>

#include <cerrno>
#include <cstdarg>
#include <cstdio>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {

/// A TIFF handle that keeps the library's last complaint.
class Tiff {
 public:
  Tiff(const Path& file, const char* mode) : file_(file) {
    struct Free {
      void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
    };
    const std::unique_ptr<TIFFOpenOptions, Free> options(TIFFOpenOptionsAlloc());
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &Tiff::hear, this);
    TIFFOpenOptionsSetWarningHandlerExtR(
        options.get(), [](TIFF*, void*, const char*, const char*, va_list) { return 1; }, nullptr);
    TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), tmsize_t{1} << 31);
    errno = 0;
    handle_.reset(TIFFOpenExt(file.c_str(), mode, options.get()));
    if (!handle_) fail(*mode == 'r' ? "read" : "written");
  }
  TIFF* get() const { return handle_.get(); }
  void check(bool done, const char* verb) {
    if (!done) fail(verb);
  }
  [[noreturn]] void fail(const char* verb) { throw Error(file_.string(), cannot(verb, errno, complaint_)); }
  const std::string& complaint() const { return complaint_; }
  void close() { handle_.reset(); }

 private:
  struct Close {
    void operator()(TIFF* tiff) const { TIFFClose(tiff); }
  };
  static int hear(TIFF*, void* self, const char*, const char* format, va_list arguments) {
    char text[512];
    std::vsnprintf(text, sizeof text, format, arguments);
    if (auto& complaint = static_cast<Tiff*>(self)->complaint_; complaint.empty()) complaint = text;
    return 1;
  }

  Path file_;
  std::string complaint_;
  std::unique_ptr<TIFF, Close> handle_;
};

}  // namespace atomcam
