#pragma once
// A stack in a file as frames to be measured.

#include <filesystem>
#include <memory>

#include "analysis/frame_sequence.hpp"

namespace atomcam {

/// Kept in memory if it is small (256 MB), else read again at each visit. Errors name file and frame.
std::unique_ptr<FrameSequence> open_frames(const std::filesystem::path& file);

}  // namespace atomcam
