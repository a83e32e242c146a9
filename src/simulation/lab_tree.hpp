#pragma once
// A lab file as a tree, whichever language it was written in: one walker reads both, one builder writes both.

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace atomcam {

struct Tree {
  enum class Kind { table, array, text, number, boolean, other };
  Kind kind = Kind::table;
  std::vector<std::pair<std::string, Tree>> members;  // table, in the order of the file
  std::vector<Tree> items;                            // array
  std::string text;                                   // text; for `other` what it is ("a date")
  double number = 0;
  bool boolean = false;
  int line = 0;         // 0: unknown
  std::string comment;  // written behind a value or above a table

  static Tree of_text(std::string_view value, std::string comment = {});
  static Tree of_number(double value, std::string comment = {});
  static Tree of_boolean(bool value, std::string comment = {});
  static Tree array();
  /// The table at a dotted path below this one, made if it is not there.
  Tree& table(std::string_view path);
  void add(std::string key, Tree value) { members.emplace_back(std::move(key), std::move(value)); }
  /// "a table", "a number", for errors.
  std::string what() const;
};

/// Throw an Error at `place` (with the line) if the text is not well formed, nests deeper than any lab does,
/// or (JSON) repeats a key.
Tree parse_toml(std::string_view text, std::string_view place);
Tree parse_json(std::string_view text, std::string_view place);

std::string to_toml(const Tree& tree, bool commented);
std::string to_json(const Tree& tree);

}  // namespace atomcam
