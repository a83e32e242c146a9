#pragma once
// --cache and --no-cache of the commands that diagnose.

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

namespace atomcam {

struct CacheOption {
  std::string folder;
  bool none = false;

  void add_to(CLI::App& command);
  /// Where to keep what was simulated; empty: nowhere.
  std::filesystem::path path() const;
};

}  // namespace atomcam
