#include "data/stack_reader.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "base/error.hpp"

namespace atomcam {
namespace {

// No camera has more; a header that says so is wrong, and is not trusted with memory.
constexpr std::uint64_t most_rows_or_columns = 1 << 17;
constexpr std::uint64_t most_pixels = 1 << 28;
constexpr std::uint64_t most_frames = std::uint64_t{1} << 40;

struct TypeFacts {
  const char* name;
  std::size_t bytes;
};
constexpr std::array facts = {
    TypeFacts{"uint8", 1},   TypeFacts{"int8", 1},    TypeFacts{"uint16", 2}, TypeFacts{"int16", 2},
    TypeFacts{"uint32", 4},  TypeFacts{"int32", 4},   TypeFacts{"uint64", 8}, TypeFacts{"int64", 8},
    TypeFacts{"float32", 4}, TypeFacts{"float64", 8},
};

/// Calls visit(value) with a value of the C++ type.
template <class Visitor>
void with_type(PixelType type, const Visitor& visit) {
  switch (type) {
    case PixelType::uint8:
      return visit(std::uint8_t{});
    case PixelType::int8:
      return visit(std::int8_t{});
    case PixelType::uint16:
      return visit(std::uint16_t{});
    case PixelType::int16:
      return visit(std::int16_t{});
    case PixelType::uint32:
      return visit(std::uint32_t{});
    case PixelType::int32:
      return visit(std::int32_t{});
    case PixelType::uint64:
      return visit(std::uint64_t{});
    case PixelType::int64:
      return visit(std::int64_t{});
    case PixelType::float32:
      return visit(float{});
    case PixelType::float64:
      return visit(double{});
  }
}

template <class Value>
bool is_count(Value value) {
  if constexpr (std::is_floating_point_v<Value>)
    return value >= 0 && value <= 65535 && value == std::floor(value);
  else
    return value >= Value{} && static_cast<std::uint64_t>(value) <= 65535;
}

}  // namespace

std::size_t bytes_of(PixelType type) {
  return facts.at(static_cast<std::size_t>(type)).bytes;
}

const char* name_of(PixelType type) {
  return facts.at(static_cast<std::size_t>(type)).name;
}

void StackReader::fail(const std::string& problem) const {
  throw Error(file_.string(), problem);
}

void StackReader::fail(std::uint64_t frame, const std::string& problem) const {
  throw Error(file_.string(), fmt::format("frame {}: {}", frame, problem));
}

void StackReader::set_shape(std::uint64_t frames, std::uint64_t rows, std::uint64_t columns, PixelType type) {
  if (rows == 0 || columns == 0) fail("frames without pixels");
  if (rows > most_rows_or_columns || columns > most_rows_or_columns || rows * columns > most_pixels)
    fail(fmt::format("frames of {} x {} pixels; at most {} on a side and {} in all can be read", rows,
                     columns, most_rows_or_columns, most_pixels));
  if (frames > most_frames) fail(fmt::format("{} frames; at most {} can be read", frames, most_frames));
  shape_ = {frames, static_cast<int>(rows), static_cast<int>(columns)};
  type_ = type;
}

void StackReader::set_notes(StackNotes notes) {
  notes_ = std::move(notes);
  const auto settings = nlohmann::json::parse(notes_.settings, nullptr, false);
  if (!settings.is_object()) return;
  const auto take = [&](const char* key, std::optional<double>& value) {
    if (const auto found = settings.find(key); found != settings.end() && found->is_number()) value = *found;
  };
  take("exposure_s", metadata_.exposure_s);
  take("em_gain", metadata_.em_gain);
  take("bias_counts", metadata_.bias_counts);
  take("electrons_per_count", metadata_.electrons_per_count);
  if (const auto camera = settings.find("camera"); camera != settings.end() && camera->is_string())
    metadata_.camera = *camera;
}

void StackReader::read_bytes(std::uint64_t frame, std::span<std::byte> pixels) {
  if (frame >= shape_.frames) fail(fmt::format("frame {} is not in it, it has {}", frame, shape_.frames));
  if (pixels.size() != shape_.pixels() * bytes_of(type_))
    fail(frame,
         fmt::format("room for {} bytes; it has {}", pixels.size(), shape_.pixels() * bytes_of(type_)));
  fetch(frame, pixels);
}

template <class Value>
void StackReader::read_as(std::uint64_t frame, std::span<Value> pixels) {
  if (pixels.size() != shape_.pixels())
    fail(frame, fmt::format("room for {} pixels; it has {}", pixels.size(), shape_.pixels()));
  with_type(type_, [&](auto as_stored) {
    using Stored = decltype(as_stored);
    if constexpr (std::is_same_v<Stored, Value>) {
      read_bytes(frame, std::as_writable_bytes(pixels));
    } else {
      bytes_.resize(pixels.size() * sizeof(Stored));
      read_bytes(frame, bytes_);
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        Stored value;
        std::memcpy(&value, bytes_.data() + i * sizeof value, sizeof value);
        if constexpr (std::is_same_v<Value, std::uint16_t>) {
          if (!is_count(value))
            fail(frame, fmt::format("pixel [{}, {}] is {}, no whole number from 0 to 65535",
                                    i / static_cast<std::size_t>(shape_.columns),
                                    i % static_cast<std::size_t>(shape_.columns), +value));
        }
        pixels[i] = static_cast<Value>(value);
      }
    }
  });
}

void StackReader::read(std::uint64_t frame, std::span<float> pixels) {
  read_as(frame, pixels);
}

void StackReader::read(std::uint64_t frame, std::span<double> pixels) {
  read_as(frame, pixels);
}

void StackReader::read(std::uint64_t frame, std::span<std::uint16_t> pixels) {
  read_as(frame, pixels);
}

CountImage StackReader::counts(std::uint64_t frame) {
  if (frame >= shape_.frames) fail(fmt::format("frame {} is not in it, it has {}", frame, shape_.frames));
  CountImage image(shape_.frame());
  read(frame, image.pixels());
  return image;
}

}  // namespace atomcam
