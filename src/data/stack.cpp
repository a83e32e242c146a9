#include "data/stack.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "data/formats.hpp"

namespace atomcam {
namespace {

struct Format {
  const char* extension;
  decltype(&write_tiff) write;
};
constexpr std::array formats = {
    Format{".tif", write_tiff},  Format{".tiff", write_tiff}, Format{".h5", write_hdf5},
    Format{".hdf5", write_hdf5}, Format{".fits", write_fits}, Format{".npy", write_npy},
};

const Format& format_of(const Path& file) {
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  const auto found = std::ranges::find(formats, extension, &Format::extension);
  if (found != formats.end()) return *found;
  std::string allowed;
  for (const Format& format : formats) allowed += std::string(allowed.empty() ? "" : ", ") + format.extension;
  throw Error(file.string(), "the extension '" + extension + "' is none of " + allowed);
}

}  // namespace

std::unique_ptr<StackWriter> StackWriter::create(const Path& file, Shape shape, StackNotes notes,
                                                 std::uint64_t expected_frames) {
  if (shape.rows <= 0 || shape.columns <= 0) throw Error(file.string(), "frames without pixels");
  return format_of(file).write(file, shape, notes, expected_frames);
}

void StackWriter::append(const CountImage& frame, const std::string& truth) {
  if (frame.shape() != shape_)
    throw Error(file_.string(), "a frame of " + std::to_string(frame.rows()) + " x " +
                                    std::to_string(frame.columns()) + " pixels in a stack of " +
                                    std::to_string(shape_.rows) + " x " + std::to_string(shape_.columns));
  // One line: line ends stand only between the tokens of JSON.
  std::string line = truth.empty() ? "null" : truth;
  std::ranges::replace_if(
      line, [](char letter) { return letter == '\n' || letter == '\r'; }, ' ');
  write(frame, line);
  ++frames_;
}

const std::vector<std::string>& stack_extensions() {
  static const std::vector<std::string> extensions = [] {
    std::vector<std::string> list;
    for (const Format& format : formats) list.emplace_back(format.extension);
    return list;
  }();
  return extensions;
}

std::string cannot(const std::string& verb, int error_number, const std::string& what) {
  const std::string reason = error_number ? std::strerror(error_number) : what;
  return "cannot be " + verb + (reason.empty() ? "" : " (" + reason + ")");
}

std::string open_notes(const StackNotes& notes) {
  return "{\"lab\":" + nlohmann::json(notes.lab).dump() +
         ",\"settings\":" + (notes.settings.empty() ? "null" : notes.settings);
}

StackNotes parse_notes(const Path& file, const std::string& text) {
  const auto json = nlohmann::ordered_json::parse(text, nullptr, false);
  if (!json.is_object()) throw Error(file.string(), "its notes are not JSON");
  StackNotes notes;
  if (const auto lab = json.find("lab"); lab != json.end() && lab->is_string()) notes.lab = *lab;
  if (const auto settings = json.find("settings"); settings != json.end() && !settings->is_null())
    notes.settings = settings->dump();
  return notes;
}

}  // namespace atomcam
