#pragma once
// How a lab's values look in a file, on the command line and in an error.

#include <optional>
#include <string>
#include <string_view>

namespace atomcam {

/// Shortest decimal that reads back as the same double.
std::string number_text(double value);
/// The whole of `text` as a number; nothing if it is none (inf and nan are none).
std::optional<double> parse_number(std::string_view text);
/// 'text' in quotes for an error, cut where it is long, control characters replaced.
std::string in_quotes(std::string_view text);
/// A string of TOML and JSON alike, with its quotes.
std::string escaped(std::string_view text);
bool is_valid_utf8(std::string_view text);

}  // namespace atomcam
