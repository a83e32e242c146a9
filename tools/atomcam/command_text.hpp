#pragma once
// A command line as a shell takes it again.

#include <string>
#include <string_view>

namespace atomcam {

class CommandText {
 public:
  explicit CommandText(std::string_view command) : text_(command) {}
  CommandText& add(std::string_view word);
  CommandText& add(std::string_view option, std::string_view value) { return add(option).add(value); }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

}  // namespace atomcam
