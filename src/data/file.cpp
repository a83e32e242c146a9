#include "data/file.hpp"

#include <cerrno>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {

File::File(std::filesystem::path file, const char* mode)
    : name_(std::move(file)), file_(std::fopen(name_.c_str(), mode)) {
  if (!file_) throw Error(name_.string(), cannot(*mode == 'r' ? "read" : "written", errno));
}

void File::write(std::span<const std::byte> bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size())
    throw Error(name_.string(), cannot("written", errno));
}

void File::seek(std::int64_t offset, int from) {
  if (fseeko(file_.get(), offset, from) != 0) throw Error(name_.string(), cannot("written", errno));
}

std::int64_t File::position() const {
  return ftello(file_.get());
}

bool File::read(std::span<std::byte> bytes) {
  const std::size_t got = std::fread(bytes.data(), 1, bytes.size(), file_.get());
  if (std::ferror(file_.get())) throw Error(name_.string(), cannot("read", errno));
  return got == bytes.size();
}

std::string File::read_all() {
  std::string text;
  char piece[65536];
  while (const std::size_t got = std::fread(piece, 1, sizeof piece, file_.get())) text.append(piece, got);
  if (std::ferror(file_.get())) throw Error(name_.string(), cannot("read", errno));
  return text;
}

void File::flush() {
  if (std::fflush(file_.get()) != 0) throw Error(name_.string(), cannot("written", errno));
}

void File::close() {
  if (file_ && std::fclose(file_.release()) != 0) throw Error(name_.string(), cannot("written", errno));
}

}  // namespace atomcam
