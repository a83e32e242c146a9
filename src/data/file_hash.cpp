#include "data/file_hash.hpp"

#include <fmt/format.h>
#include <fnmatch.h>
#include <nettle/sha2.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <vector>

#include "base/error.hpp"

namespace atomcam {
namespace {

class Hash {
 public:
  Hash() { sha256_init(&state_); }
  void add(const char* bytes, std::size_t size) {
    sha256_update(&state_, size, reinterpret_cast<const std::uint8_t*>(bytes));
  }
  std::string digits() {
    std::array<std::uint8_t, SHA256_DIGEST_SIZE> digest;
    sha256_digest(&state_, digest.size(), digest.data());
    std::string text;
    for (const std::uint8_t byte : digest) text += fmt::format("{:02x}", byte);
    return text;
  }

 private:
  sha256_ctx state_;
};

std::string of_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(file.string(), "cannot be read");
  Hash hash;
  std::vector<char> buffer(1 << 20);
  while (in) {
    in.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    hash.add(buffer.data(), static_cast<std::size_t>(in.gcount()));
  }
  if (in.bad()) throw Error(file.string(), "cannot be read to its end");
  return hash.digits();
}

std::string of_files(const std::filesystem::path& folder, const std::string& pattern) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.is_regular_file() && fnmatch(pattern.c_str(), entry.path().filename().c_str(), FNM_PERIOD) == 0)
      files.push_back(entry.path());
  std::ranges::sort(files);
  Hash hash;
  for (const std::filesystem::path& file : files) {
    const std::string line = of_file(file) + "  " + file.filename().string() + "\n";
    hash.add(line.data(), line.size());
  }
  return hash.digits();
}

}  // namespace

std::string sha256_of(const std::filesystem::path& stack_or_file) {
  namespace fs = std::filesystem;
  if (fs::is_regular_file(stack_or_file)) return of_file(stack_or_file);
  if (fs::is_directory(stack_or_file)) return of_files(stack_or_file, "*");
  const std::string name = stack_or_file.string();
  if (const auto colon = name.find_last_of(':');
      colon != std::string::npos && fs::is_regular_file(name.substr(0, colon)))
    return of_file(name.substr(0, colon));
  const fs::path folder = stack_or_file.has_parent_path() ? stack_or_file.parent_path() : fs::path(".");
  if (fs::is_directory(folder) && name.find_first_of("*?[") != std::string::npos)
    return of_files(folder, stack_or_file.filename().string());
  return of_file(stack_or_file);
}

}  // namespace atomcam
