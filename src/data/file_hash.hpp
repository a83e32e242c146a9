#pragma once
// Which data it was: their SHA-256.

#include <filesystem>
#include <string>

namespace atomcam {

/// 64 hexadecimal digits. Of a stack named "file.h5:/dataset" the file's; of a folder of frames, or some of
/// them ("folder/a_*.tif"), that of a list of "digits  name" lines, as sha256sum prints it, sorted by name.
/// Throws an Error that names the file if it cannot be read.
std::string sha256_of(const std::filesystem::path& stack_or_file);

}  // namespace atomcam
