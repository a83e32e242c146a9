#pragma once
// Is a page well-formed, and does it stand alone?

#include <string>
#include <string_view>
#include <vector>

namespace atomcam {

/// What is wrong with the nesting of a page's tags or with its ampersands; empty if nothing is.
inline std::string markup_fault(std::string_view text) {
  std::vector<std::string> open;
  std::size_t at = text.find("<html");
  if (at == std::string_view::npos) return "no <html>";
  while (at < text.size()) {
    if (text[at] == '&') {
      const auto end = text.find(';', at);
      const std::string_view name = end == std::string_view::npos ? "" : text.substr(at + 1, end - at - 1);
      if (name != "amp" && name != "lt" && name != "gt" && name != "quot")
        return "bare & before '" + std::string(text.substr(at, 12)) + "'";
    }
    if (static_cast<unsigned char>(text[at]) < 32 && text[at] != '\n' && text[at] != '\t')
      return "a control character";
    if (text[at] != '<') {
      ++at;
      continue;
    }
    // Attributes are quoted, and hold no < or >.
    const auto end = text.find('>', at);
    if (end == std::string_view::npos) return "a tag without its end";
    const std::string_view tag = text.substr(at + 1, end - at - 1);
    if (tag.find('<') != std::string_view::npos) return "< within a tag";
    const std::string name(tag.substr(0, tag.find_first_of(" \n")));
    if (name.starts_with('/')) {
      if (open.empty() || open.back() != name.substr(1))
        return "<" + name + "> closes <" + (open.empty() ? "nothing" : open.back()) + ">";
      open.pop_back();
    } else if (!tag.ends_with('/')) {
      open.push_back(name);
    }
    at = end + 1;
  }
  return open.empty() ? "" : "<" + open.back() + "> is left open";
}

/// The first thing in a page that a browser would fetch; empty if there is none.
inline std::string outside_reference(std::string_view text) {
  for (const std::string_view mark : {"<script", "<link", "<iframe", "<object", "@import", "url(", "//"})
    for (std::size_t at = text.find(mark); at != std::string_view::npos; at = text.find(mark, at + 1)) {
      // Base64 has slashes too.
      const auto start = text.rfind('"', at);
      if (mark == "//" && start != std::string_view::npos && text.substr(start + 1, 5) == "data:") continue;
      return std::string(text.substr(at, 40));
    }
  for (const std::string_view attribute : {"src=\"", "href=\""})
    for (std::size_t at = text.find(attribute); at != std::string_view::npos;
         at = text.find(attribute, at + 1))
      if (text.substr(at + attribute.size(), 22) != "data:image/png;base64,")
        return std::string(text.substr(at, 40));
  return {};
}

}  // namespace atomcam
