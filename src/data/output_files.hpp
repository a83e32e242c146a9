#pragma once
// Files that results are written into.

#include <filesystem>
#include <string_view>

namespace atomcam {

/// Makes the folder if it is not there. Throws an Error at `place` if it cannot be.
void make_folder(const std::filesystem::path& folder, std::string_view place);

/// Throws an Error at `place` if the folder is not there and cannot be made, or cannot be written into.
/// Leaves everything as it was.
void check_folder(const std::filesystem::path& folder, std::string_view place);

/// Writes the whole text; an existing file is replaced. Throws an Error that names the file.
void write_text(const std::filesystem::path& file, std::string_view text);

}  // namespace atomcam
