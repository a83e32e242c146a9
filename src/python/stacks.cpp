#include <fmt/format.h>
#include <pybind11/stl.h>

#include <cstring>
#include <limits>

#include "analysis/frame_sequence.hpp"
#include "base/error.hpp"
#include "calibration/notes.hpp"
#include "calibration/stack_frames.hpp"
#include "data/file_hash.hpp"
#include "python/bindings.hpp"

namespace atomcam {
namespace {

/// Frames where they lie in a NumPy array, whatever its strides; only the frame at hand is copied. Has to be
/// destroyed under the interpreter's lock.
class FramesOfArray : public FrameSequence {
 public:
  explicit FramesOfArray(py::array array) : array_(std::move(array)) {
    if (array_.ndim() != 3 || !py::isinstance<py::array_t<std::uint16_t, 0>>(array_))
      throw Error("array", "allowed a NumPy array [frame, row, column] of uint16");
    for (const int axis : {1, 2})
      if (array_.shape(axis) > std::numeric_limits<int>::max())
        throw Error("array", fmt::format("shape {}", py::str(array_.attr("shape")).cast<std::string>()));
    frames_ = static_cast<std::size_t>(array_.shape(0));
    shape_ = {static_cast<int>(array_.shape(1)), static_cast<int>(array_.shape(2))};
    memory_ = static_cast<const char*>(array_.data());
    for (int axis = 0; axis < 3; ++axis) strides_[axis] = array_.strides(axis);
  }
  std::size_t frames() const override { return frames_; }
  Shape shape() const override { return shape_; }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    CountImage frame(shape_);
    for (std::size_t n = 0; n < frames_; ++n) {
      for (int r = 0; r < shape_.rows; ++r) {
        const char* from = memory_ + static_cast<py::ssize_t>(n) * strides_[0] + r * strides_[1];
        const auto row = frame.row(r);
        if (strides_[2] == sizeof(std::uint16_t)) {
          std::memcpy(row.data(), from, row.size_bytes());
        } else {
          for (int c = 0; c < shape_.columns; ++c)
            std::memcpy(&row[static_cast<std::size_t>(c)], from + c * strides_[2], sizeof(std::uint16_t));
        }
      }
      take(n, frame);
    }
  }

 private:
  py::array array_;
  const char* memory_ = nullptr;
  py::ssize_t strides_[3] = {};
  std::size_t frames_ = 0;
  Shape shape_;
};

}  // namespace

void bind_stacks(py::module_& module) {
  module.def(
      "sha256_of", [](const std::string& file) { return sha256_of(file); }, py::arg("file"),
      py::call_guard<py::gil_scoped_release>(), "Of a file, or a folder of frames.");

  py::class_<FrameSequence, std::shared_ptr<FrameSequence>>(module, "Frames",
                                                            "Frames to be gone through, always the same.")
      .def_static(
          "open", [](const std::string& file) { return std::shared_ptr<FrameSequence>(open_frames(file)); },
          py::arg("file"), py::call_guard<py::gil_scoped_release>(), "A stack in a file.")
      .def_static(
          "of_array",
          [](py::array array) -> std::shared_ptr<FrameSequence> {
            return std::make_shared<FramesOfArray>(std::move(array));
          },
          py::arg("array"), "uint16 [frame, row, column], where they lie.")
      .def(
          "shape",
          [](const FrameSequence& frames) {
            return py::make_tuple(frames.frames(), frames.shape().rows, frames.shape().columns);
          },
          "Frames, rows, columns.");

  py::class_<Notes>(module, "Notes", "What an experimenter wrote down.")
      .def_static(
          "read", [](const std::string& file) { return read_notes(file); }, py::arg("file"), "TOML or JSON.")
      .def_static(
          "parse", [](const std::string& text, const std::string& place) { return parse_notes(text, place); },
          py::arg("text"), py::arg("place"), "JSON.")
      .def(
          "not_understood", [](const Notes& notes) { return notes.not_understood; },
          "Keys that were left alone.");
}

}  // namespace atomcam
