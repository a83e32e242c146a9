#include "data/output_files.hpp"

#include <unistd.h>
#include <fstream>
#include <vector>

#include "base/error.hpp"

namespace atomcam {

void make_folder(const std::filesystem::path& folder, std::string_view place) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (problem || !std::filesystem::is_directory(folder))
    throw Error(place, "folder " + folder.string() + " cannot be made" +
                           (problem ? ": " + problem.message() : std::string()));
}

void check_folder(const std::filesystem::path& folder, std::string_view place) {
  std::vector<std::filesystem::path> missing;  // the deepest first
  std::error_code ignored;
  for (std::filesystem::path at = std::filesystem::absolute(folder, ignored);
       !at.empty() && !std::filesystem::exists(at, ignored); at = at.parent_path())
    missing.push_back(at);
  make_folder(folder, place);
  const bool writable = ::access(folder.c_str(), W_OK) == 0;
  for (const std::filesystem::path& one : missing) std::filesystem::remove(one, ignored);
  if (!writable) throw Error(place, "folder " + folder.string() + " cannot be written into");
}

void write_text(const std::filesystem::path& file, std::string_view text) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  out.close();
  if (!out) throw Error(file.string(), "cannot be written");
}

}  // namespace atomcam
