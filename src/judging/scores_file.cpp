#include "judging/scores_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.hpp"
#include "data/file.hpp"
#include "data/stack_reader.hpp"

namespace atomcam {
namespace {

class Collector {
 public:
  Collector(std::string place, std::uint64_t frames, std::size_t sites) : place_(std::move(place)) {
    scores_.frames = frames;
    scores_.sites = sites;
  }
  [[noreturn]] void fail(const std::string& problem) const {
    throw Error(place_, fmt::format("frame {}: {}", frame_, problem));
  }
  void add_frame(const std::vector<double>& values) {
    if (frame_ >= scores_.frames)
      throw Error(place_, fmt::format("more than the stack's {} frames", scores_.frames));
    if (values.size() != scores_.sites)
      fail(fmt::format("{} values; the lab has {} sites", values.size(), scores_.sites));
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!std::isfinite(values[i])) fail(fmt::format("site {} is {}", i, values[i]));
      scores_.values.push_back(static_cast<float>(values[i]));
    }
    ++frame_;
  }
  SiteScores finish() {
    if (frame_ != scores_.frames)
      throw Error(place_, fmt::format("{} frames; the stack has {}", frame_, scores_.frames));
    return std::move(scores_);
  }

 private:
  std::string place_;
  SiteScores scores_;
  std::uint64_t frame_ = 0;
};

/// Nothing if a word of the line is no number.
std::optional<std::vector<double>> numbers(std::string_view line) {
  std::vector<double> values;
  const auto between = [](char letter) {
    return letter == ',' || letter == ';' || letter == ' ' || letter == '\t' || letter == '\r';
  };
  for (const char *at = line.data(), *end = at + line.size(); at < end;) {
    if (between(*at)) {
      ++at;
      continue;
    }
    const auto [next, problem] = std::from_chars(at, end, values.emplace_back());
    if (problem != std::errc{} || (next < end && !between(*next))) return std::nullopt;
    at = next;
  }
  return values;
}

void read_csv(Collector& scores, const std::string& text) {
  bool first = true;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = std::string_view(text).substr(at, end - at);
    at = end + 1;
    if (line.find_first_not_of(" \t\r") == line.npos || line.front() == '#') continue;
    if (const auto values = numbers(line))
      scores.add_frame(*values);
    else if (!first)
      scores.fail("not a line of numbers");
    first = false;
  }
}

void read_json(Collector& scores, const std::string& place, const std::string& text) {
  auto json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_object())
    for (const char* key : {"scores", "probability", "occupancy"})
      if (json.contains(key)) {
        json = nlohmann::json(json[key]);
        break;
      }
  if (!json.is_array()) throw Error(place, "no JSON list of frames");
  for (const auto& frame : json) {
    std::vector<double> values;
    if (frame.is_string()) {
      for (const char digit : frame.get_ref<const std::string&>()) {
        if (digit != '0' && digit != '1') scores.fail("a text of other letters than 0 and 1");
        values.push_back(digit - '0');
      }
    } else if (frame.is_array()) {
      for (const auto& value : frame) {
        if (!value.is_number() && !value.is_boolean()) scores.fail("a value that is no number");
        values.push_back(value.is_boolean() ? value.get<bool>() : value.get<double>());
      }
    } else {
      scores.fail("neither a list nor a text");
    }
    scores.add_frame(values);
  }
}

}  // namespace

SiteScores read_scores(const std::filesystem::path& file, std::uint64_t frames, std::size_t sites) {
  Collector scores(file.string(), frames, sites);
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  if (extension == ".csv" || extension == ".txt") {
    read_csv(scores, File(file, "rb").read_all());
  } else if (extension == ".json") {
    read_json(scores, file.string(), File(file, "rb").read_all());
  } else {
    const auto stack = open_stack(file);
    std::vector<double> values(stack->shape().pixels());
    const auto columns = static_cast<std::size_t>(stack->shape().columns);
    for (std::uint64_t n = 0; n < stack->frames(); ++n) {
      stack->read(n, std::span(values));
      if (stack->frames() == 1 && columns == sites &&
          static_cast<std::uint64_t>(stack->shape().rows) == frames) {
        for (std::uint64_t r = 0; r < frames; ++r)
          scores.add_frame({values.begin() + static_cast<std::ptrdiff_t>(r * sites),
                            values.begin() + static_cast<std::ptrdiff_t>((r + 1) * sites)});
      } else {
        scores.add_frame(values);
      }
    }
  }
  return scores.finish();
}

}  // namespace atomcam
