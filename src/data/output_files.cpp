#include "data/output_files.hpp"

#include <fstream>

#include "base/error.hpp"

namespace atomcam {

void make_folder(const std::filesystem::path& folder, std::string_view place) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (problem || !std::filesystem::is_directory(folder))
    throw Error(place, "folder " + folder.string() + " cannot be made" +
                           (problem ? ": " + problem.message() : std::string()));
}

void write_text(const std::filesystem::path& file, std::string_view text) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  out.close();
  if (!out) throw Error(file.string(), "cannot be written");
}

}  // namespace atomcam
