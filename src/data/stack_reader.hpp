#pragma once
// Stacks [frame, row, column] read frame by frame, in memory for one frame. docs/data.md tells what is read.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/image.hpp"

namespace atomcam {

struct StackShape {
  std::uint64_t frames = 0;
  int rows = 0;
  int columns = 0;
  Shape frame() const { return {rows, columns}; }
  std::size_t pixels() const { return frame().pixels(); }  // of one frame
  bool operator==(const StackShape&) const = default;
};

/// How a file keeps a pixel.
enum class PixelType { uint8, int8, uint16, int16, uint32, int32, uint64, int64, float32, float64 };

std::size_t bytes_of(PixelType type);
const char* name_of(PixelType type);  // as NumPy has it

/// What made a stack; both may be empty.
struct StackNotes {
  std::string lab;       // lab file, TOML
  std::string settings;  // JSON object
  bool operator==(const StackNotes&) const = default;
};

/// What a file says about how its frames came about; empty where it says nothing.
struct StackMetadata {
  std::string camera;
  std::optional<double> exposure_s;
  std::optional<double> em_gain;
  std::optional<double> bias_counts;
  std::optional<double> electrons_per_count;
  std::optional<double> temperature_c;
  std::vector<double> timestamps_s;           // one per frame, seconds from an origin of the format's own
  std::map<std::string, std::string> others;  // by the format's own names
};

/// Frames in any order. One reader belongs to one thread at a time; several readers may have one file open.
class StackReader {
 public:
  virtual ~StackReader() = default;
  StackReader(const StackReader&) = delete;
  StackReader& operator=(const StackReader&) = delete;

  const std::filesystem::path& file() const { return file_; }
  const StackShape& shape() const { return shape_; }
  std::uint64_t frames() const { return shape_.frames; }
  PixelType type() const { return type_; }
  const StackMetadata& metadata() const { return metadata_; }
  const StackNotes& notes() const { return notes_; }

  /// One frame into the caller's memory, shape().pixels() values, row by row.
  void read(std::uint64_t frame, std::span<float> pixels);
  void read(std::uint64_t frame, std::span<double> pixels);
  /// Throws an Error that names file, frame and value where a pixel is no whole number from 0 to 65535.
  void read(std::uint64_t frame, std::span<std::uint16_t> pixels);
  /// As the file keeps it, in this machine's byte order: shape().pixels() * bytes_of(type()) bytes.
  void read_bytes(std::uint64_t frame, std::span<std::byte> pixels);
  CountImage counts(std::uint64_t frame);
  /// JSON; "null" for none.
  virtual std::string truth(std::uint64_t) { return "null"; }

 protected:
  explicit StackReader(std::filesystem::path file) : file_(std::move(file)) {}
  /// Checks what a header says before anyone asks for memory.
  void set_shape(std::uint64_t frames, std::uint64_t rows, std::uint64_t columns, PixelType type);
  void set_notes(StackNotes notes);
  /// `frame` is in the stack and `pixels` has its size.
  virtual void fetch(std::uint64_t frame, std::span<std::byte> pixels) = 0;
  [[noreturn]] void fail(const std::string& problem) const;
  [[noreturn]] void fail(std::uint64_t frame, const std::string& problem) const;

  std::filesystem::path file_;
  StackShape shape_;
  PixelType type_ = PixelType::uint16;
  StackMetadata metadata_;
  StackNotes notes_;

 private:
  template <class Value>
  void read_as(std::uint64_t frame, std::span<Value> pixels);

  std::vector<std::byte> bytes_;  // one frame, where it has to be converted
};

/// A file of any format that is known, told by its content; a folder of frames in natural order of their
/// names ("folder/probe_*.tif" takes some of them); "file.h5:/path/to/dataset" and "file.npz:name" choose one
/// of several arrays. Throws an Error that names the file, and the frame where it is about one.
std::unique_ptr<StackReader> open_stack(const std::filesystem::path& stack);

}  // namespace atomcam
