#pragma once
// Stacks of frames written to files, [frame, row, column] of 16-bit counts, with each frame's truth and what
// made them:
//   .tif .tiff   one page a frame (BigTIFF from 4 GB on); its ImageDescription is JSON with the frame's truth
//   .h5 .hdf5    datasets "frames" [n, rows, columns], "truth" [n] (JSON texts), "lab", "settings"
//   .fits        a cube in the primary array, tables TRUTH (one row a frame) and NOTES behind it
//   .npy         the array; truth in NAME.truth.jsonl (a line a frame), notes in NAME.settings.json

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/image.hpp"
#include "data/stack_reader.hpp"

namespace atomcam {

/// Writes frame by frame. What cannot be written throws an Error that names the file.
class StackWriter {
 public:
  /// The format follows from the extension; an existing file is replaced. `expected_frames`: how many will
  /// come, 0 = unknown; more or fewer may (a TIFF that was announced below 4 GB cannot grow beyond).
  static std::unique_ptr<StackWriter> create(const std::filesystem::path& file, Shape shape, StackNotes notes,
                                             std::uint64_t expected_frames = 0);
  virtual ~StackWriter() = default;
  /// `truth`: JSON, or empty for none.
  void append(const CountImage& frame, const std::string& truth);
  /// Completes the file with the frames that came, however many. Without it (an exception on the way) the
  /// destructor completes it as far as it can, in silence.
  virtual void finish() = 0;
  std::uint64_t frames() const { return frames_; }

 protected:
  StackWriter(std::filesystem::path file, Shape shape) : file_(std::move(file)), shape_(shape) {}
  virtual void write(const CountImage& frame, const std::string& truth) = 0;

  std::filesystem::path file_;
  Shape shape_;
  std::uint64_t frames_ = 0;
};

/// Extensions with their dot, in the order of the list above.
const std::vector<std::string>& stack_extensions();

}  // namespace atomcam
