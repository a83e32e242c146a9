#pragma once
// Which file it was: its SHA-256.

#include <filesystem>
#include <string>

namespace atomcam {

/// 64 hexadecimal digits. Throws an Error that names the file if it cannot be read.
std::string sha256_of_file(const std::filesystem::path& file);

}  // namespace atomcam
