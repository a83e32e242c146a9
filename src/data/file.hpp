#pragma once
// A file whose every failure is an Error that names it.

#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace atomcam {

class File {
 public:
  /// `mode` as of fopen.
  File(std::filesystem::path file, const char* mode);
  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }
  void seek(std::int64_t offset, int from = SEEK_SET);
  std::int64_t position() const;
  /// False at the end of the file.
  bool read(std::span<std::byte> bytes);
  std::string read_all();
  /// So that what was written is in the file even if this process is killed.
  void flush();
  void close();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::filesystem::path name_;
  std::unique_ptr<std::FILE, Close> file_;
};

}  // namespace atomcam
