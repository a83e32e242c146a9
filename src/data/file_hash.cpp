#include "data/file_hash.hpp"

#include <fnmatch.h>

#include <algorithm>
#include <fstream>
#include <vector>

#include "base/error.hpp"
#include "data/sha256.hpp"

namespace atomcam {
namespace {

std::string of_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(file.string(), "cannot be read");
  Sha256 hash;
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
  Sha256 hash;
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
