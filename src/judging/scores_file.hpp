#pragma once
// What a detector says, from a file.

#include <filesystem>

#include "judging/judgement.hpp"

namespace atomcam {

/// CSV: a line a frame, a column a site (a first line of names and lines with # are passed over); JSON: a
/// list of lists of numbers, or of texts "0110", one per frame, perhaps as the key "scores" of an object;
/// .npy, .npz, HDF5: [frame, site], or [frame, row, column] of a grid. Throws an Error that names the file
/// and the frame.
SiteScores read_scores(const std::filesystem::path& file, std::uint64_t frames, std::size_t sites);

}  // namespace atomcam
