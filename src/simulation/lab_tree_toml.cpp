#include <cmath>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "base/error.hpp"
#include "simulation/lab_tree.hpp"

namespace atomcam {
namespace {

int line_of(const toml::node& node) {
  return static_cast<int>(node.source().begin.line);
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
  try {
    return convert(toml::parse(text));
  } catch (const toml::parse_error& error) {
    throw Error(fmt::format("{}:{}", place, error.source().begin.line),
                fmt::format("not TOML: {}", error.description()));
  }
}

}  // namespace atomcam
