#include "atomcam/cache_option.hpp"

#include <cstdlib>

namespace atomcam {

void CacheOption::add_to(CLI::App& command) {
  command.add_option(
      "--cache", folder,
      "Folder that keeps what was simulated, for the next diagnosis of the same frames (default: "
      "atomcam in the user's cache, at most 4 GiB)");
  command.add_flag("--no-cache", none, "Simulate everything anew and keep nothing");
}

/// The user's cache is where the XDG base directory specification puts it.
std::filesystem::path CacheOption::path() const {
  if (none) return {};
  if (!folder.empty()) return folder;
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache && *cache == '/')
    return std::filesystem::path(cache) / "atomcam";
  if (const char* home = std::getenv("HOME"); home && *home == '/')
    return std::filesystem::path(home) / ".cache/atomcam";
  return {};
}

}  // namespace atomcam
