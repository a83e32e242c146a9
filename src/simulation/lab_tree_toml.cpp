#include <algorithm>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "base/error.hpp"
#include "simulation/lab_tree.hpp"

namespace atomcam {
namespace {

int line_of(const toml::node& node) {
  return static_cast<int>(node.source().begin.line);
}

/// Dotted names nest without a limit of toml++'s, and it frees what it read by recursion: long ones are
/// refused before it sees them. (Nested brackets it limits itself.) Knows strings and comments apart from
/// names.
void refuse_long_names(std::string_view text, std::string_view place) {
  constexpr int deepest = 64;
  int dots = 0;
  int line = 1;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char letter = text[i];
    if (letter == '#') {
      i = std::min(text.find('\n', i), text.size()) - 1;
    } else if (letter == '"' || letter == '\'') {
      const std::string_view triple = letter == '"' ? "\"\"\"" : "'''";
      const bool is_long = text.substr(i, 3) == triple;
      i += is_long ? 3 : 1;
      const auto ends = [&] {
        return is_long ? text.substr(i, 3) == triple : text[i] == letter || text[i] == '\n';
      };
      for (; i < text.size() && !ends(); ++i) {
        if (text[i] == '\n') ++line;
        if (letter == '"' && text[i] == '\\') ++i;
      }
      if (is_long) {
        i += 2;
        while (i + 1 < text.size() && text[i + 1] == letter)
          ++i;  // up to two quotes more belong to the string
      } else if (i < text.size() && text[i] == '\n') {
        --i;  // not closed: toml++ says so
      }
    } else if (letter == '.') {
      if (++dots > deepest) throw Error(fmt::format("{}:{}", place, line), "nested deeper than 64 levels");
    } else if (letter == '\n' || letter == '=' || letter == ',' || letter == '{' || letter == '}' ||
               letter == '[' || letter == ']') {
      dots = 0;
      line += letter == '\n';
    }
  }
}

// toml++ itself refuses more than 256 nested values, so this recursion is bounded.
Tree convert(const toml::node& node) {
  Tree tree;
  tree.line = line_of(node);
  if (const auto* table = node.as_table()) {
    for (const auto& [key, member] : *table) {
      tree.add(std::string(key.str()), convert(member));
      if (tree.members.back().second.line == 0) {
        tree.members.back().second.line = static_cast<int>(key.source().begin.line);
      }
    }
  } else if (const auto* array = node.as_array()) {
    tree.kind = Tree::Kind::array;
    for (const auto& item : *array) tree.items.push_back(convert(item));
  } else if (const auto* text = node.as_string()) {
    tree.kind = Tree::Kind::text;
    tree.text = text->get();
  } else if (const auto* integer = node.as_integer()) {
    tree.kind = Tree::Kind::number;
    tree.number = static_cast<double>(integer->get());
  } else if (const auto* floating = node.as_floating_point()) {
    tree.kind = Tree::Kind::number;
    tree.number = floating->get();
  } else if (const auto* boolean = node.as_boolean()) {
    tree.kind = Tree::Kind::boolean;
    tree.boolean = boolean->get();
  } else {
    tree.kind = Tree::Kind::other;
    tree.text = "a date or time";
  }
  return tree;
}

}  // namespace

Tree parse_toml(std::string_view text, std::string_view place) {
  refuse_long_names(text, place);
  try {
    return convert(toml::parse(text));
  } catch (const toml::parse_error& error) {
    throw Error(fmt::format("{}:{}", place, error.source().begin.line),
                fmt::format("not TOML: {}", error.description()));
  }
}

}  // namespace atomcam
