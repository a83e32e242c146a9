#include "atomcam/command_text.hpp"

namespace atomcam {

CommandText& CommandText::add(std::string_view word) {
  constexpr std::string_view plain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./=:,+@%";
  text_ += ' ';
  if (!word.empty() && word.find_first_not_of(plain) == std::string_view::npos) {
    text_ += word;
    return *this;
  }
  text_ += '\'';
  for (const char c : word) {
    if (c == '\'')
      text_ += "'\\''";
    else
      text_ += c;
  }
  text_ += '\'';
  return *this;
}

}  // namespace atomcam
