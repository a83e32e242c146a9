#include "simulation/lab_tree.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "simulation/lab_text_form.hpp"

namespace atomcam {

Tree Tree::of_text(std::string_view value, std::string comment) {
  Tree tree;
  tree.kind = Kind::text;
  tree.text = value;
  tree.comment = std::move(comment);
  return tree;
}

Tree Tree::of_number(double value, std::string comment) {
  Tree tree;
  tree.kind = Kind::number;
  tree.number = value;
  tree.comment = std::move(comment);
  return tree;
}

Tree Tree::of_boolean(bool value, std::string comment) {
  Tree tree;
  tree.kind = Kind::boolean;
  tree.boolean = value;
  tree.comment = std::move(comment);
  return tree;
}

Tree Tree::array() {
  Tree tree;
  tree.kind = Kind::array;
  return tree;
}

Tree& Tree::table(std::string_view path) {
  if (path.empty()) return *this;
  const std::string first(path.substr(0, path.find('.')));
  const std::string_view rest =
      first.size() < path.size() ? path.substr(first.size() + 1) : std::string_view{};
  for (auto& [key, member] : members) {
    if (key == first) return member.table(rest);
  }
  members.emplace_back(first, Tree{});
  return members.back().second.table(rest);
}

std::string Tree::what() const {
  switch (kind) {
    case Kind::table:
      return "a table";
    case Kind::array:
      return "a list";
    case Kind::text:
      return "the text " + in_quotes(text);
    case Kind::number:
      return "the number " + number_text(number);
    case Kind::boolean:
      return boolean ? "true" : "false";
    case Kind::other:
      return text;
  }
  return {};
}

namespace {

std::string scalar(const Tree& tree) {
  switch (tree.kind) {
    case Tree::Kind::text:
      return escaped(tree.text);
    case Tree::Kind::number:
      return number_text(tree.number);
    case Tree::Kind::boolean:
      return tree.boolean ? "true" : "false";
    default:
      return {};
  }
}

/// An entry of a list, on one line.
std::string inline_text(const Tree& tree) {
  if (tree.kind != Tree::Kind::table) return scalar(tree);
  std::string text = "{";
  for (const auto& [key, member] : tree.members) {
    text += fmt::format("{}{} = {}", text.size() > 1 ? ", " : "", key, scalar(member));
  }
  return text + "}";
}

void write_comment(std::string& out, const Tree& tree, bool commented) {
  if (commented && !tree.comment.empty()) out += "# " + tree.comment + "\n";
}

std::string line_of(const std::string& key, const Tree& member, bool commented) {
  if (member.kind != Tree::Kind::array) return fmt::format("{} = {}", key, scalar(member));
  std::string line = fmt::format("{} = [", key);
  for (const Tree& item : member.items) {
    line += fmt::format("\n  {},", inline_text(item));
    if (commented && !item.comment.empty()) line += "  # " + item.comment;
  }
  return line + (member.items.empty() ? "]" : "\n]");
}

void write_table(std::string& out, const Tree& table, const std::string& path, bool commented) {
  // What belongs to the table itself comes before its first sub-table; comments stand in one column.
  constexpr std::size_t furthest = 52;
  std::size_t column = 0;
  for (const auto& [key, member] : table.members) {
    if (member.kind == Tree::Kind::table || member.kind == Tree::Kind::array) continue;
    column = std::max(column, line_of(key, member, commented).size());
  }
  column = std::min(column, furthest);
  for (const auto& [key, member] : table.members) {
    if (member.kind == Tree::Kind::table) continue;
    const std::string line = line_of(key, member, commented);
    if (member.kind == Tree::Kind::array) {
      write_comment(out, member, commented);
      out += line + "\n";
    } else if (commented && !member.comment.empty()) {
      out += fmt::format("{:<{}}  # {}\n", line, column, member.comment);
    } else {
      out += line + "\n";
    }
  }
  for (const auto& [key, member] : table.members) {
    if (member.kind != Tree::Kind::table) continue;
    const std::string inner = path.empty() ? key : path + "." + key;
    const bool own_lines = std::any_of(member.members.begin(), member.members.end(),
                                       [](const auto& one) { return one.second.kind != Tree::Kind::table; });
    if (own_lines) {
      out += "\n";
      write_comment(out, member, commented);
      out += fmt::format("[{}]\n", inner);
    }
    write_table(out, member, inner, commented);
  }
}

void write_json(std::string& out, const Tree& tree, std::size_t depth) {
  const std::string indent(2 * depth + 2, ' ');
  const std::string closing(2 * depth, ' ');
  if (tree.kind == Tree::Kind::table) {
    out += "{";
    for (std::size_t i = 0; i < tree.members.size(); ++i) {
      out += (i ? ",\n" : "\n") + indent + escaped(tree.members[i].first) + ": ";
      write_json(out, tree.members[i].second, depth + 1);
    }
    out += tree.members.empty() ? "}" : "\n" + closing + "}";
  } else if (tree.kind == Tree::Kind::array) {
    out += "[";
    for (std::size_t i = 0; i < tree.items.size(); ++i) {
      out += (i ? ",\n" : "\n") + indent;
      write_json(out, tree.items[i], depth + 1);
    }
    out += tree.items.empty() ? "]" : "\n" + closing + "]";
  } else {
    out += scalar(tree);
  }
}

}  // namespace

std::string to_toml(const Tree& tree, bool commented) {
  std::string out;
  write_comment(out, tree, commented);
  write_table(out, tree, "", commented);
  return out;
}

std::string to_json(const Tree& tree) {
  std::string out;
  write_json(out, tree, 0);
  return out + "\n";
}

}  // namespace atomcam
