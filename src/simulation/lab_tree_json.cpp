#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "simulation/lab_text_form.hpp"
#include "simulation/lab_tree.hpp"

namespace atomcam {
namespace {

/// Reads the text once and counts its lines on the way.
class CountingIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  CountingIterator(const char* position, int* line) : position_(position), line_(line) {}
  reference operator*() const { return *position_; }
  CountingIterator& operator++() {
    if (*position_ == '\n') ++*line_;
    ++position_;
    return *this;
  }
  CountingIterator operator++(int) {
    const CountingIterator before = *this;
    ++*this;
    return before;
  }
  bool operator==(const CountingIterator& other) const { return position_ == other.position_; }
  bool operator!=(const CountingIterator& other) const { return !(*this == other); }

 private:
  const char* position_;
  int* line_;
};

/// Builds the tree from the parser's events, without recursion.
class Builder {
 public:
  Builder(std::string_view place, const int* line) : place_(place), line_(line) {}

  bool null() { return put(other("null")); }
  bool boolean(bool value) { return put(Tree::of_boolean(value)); }
  bool number_integer(std::int64_t value) { return put(Tree::of_number(static_cast<double>(value))); }
  bool number_unsigned(std::uint64_t value) { return put(Tree::of_number(static_cast<double>(value))); }
  bool number_float(double value, const std::string&) { return put(Tree::of_number(value)); }
  bool string(std::string& value) { return put(Tree::of_text(value)); }
  bool binary(std::vector<std::uint8_t>&) { return put(other("binary data")); }
  bool start_object(std::size_t) { return open(Tree{}); }
  bool start_array(std::size_t) { return open(Tree::array()); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }

  bool key(std::string& name) {
    const auto& members = open_.back().members;
    constexpr std::size_t most = 1000;  // far above a lab's, and keeps the search below short
    if (members.size() >= most) fail("more than 1000 keys in one table");
    for (const auto& member : members) {
      if (member.first == name) fail("key " + in_quotes(name) + " twice");
    }
    keys_.back() = name;
    return true;
  }

  bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception& error) {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: syntax error ...": the last part
    // says it.
    std::string problem = error.what();
    const auto start = problem.find(": ");
    if (start != std::string::npos) problem.erase(0, start + 2);
    fail("not JSON: " + (problem.size() > 200 ? problem.substr(0, 200) + "..." : problem));
  }

  Tree take() { return std::move(root_); }

 private:
  static Tree other(const char* what) {
    Tree tree;
    tree.kind = Tree::Kind::other;
    tree.text = what;
    return tree;
  }

  [[noreturn]] void fail(const std::string& problem) const {
    throw Error(fmt::format("{}:{}", place_, *line_), problem);
  }

  bool put(Tree tree) {
    if (tree.line == 0) tree.line = *line_;
    if (open_.empty()) {
      root_ = std::move(tree);
    } else if (open_.back().kind == Tree::Kind::table) {
      open_.back().add(keys_.back(), std::move(tree));
    } else {
      open_.back().items.push_back(std::move(tree));
    }
    return true;
  }

  bool open(Tree tree) {
    constexpr std::size_t deepest = 64;
    if (open_.size() >= deepest) fail("nested deeper than 64 levels");
    tree.line = *line_;
    open_.push_back(std::move(tree));
    keys_.emplace_back();
    return true;
  }

  bool close() {
    Tree done = std::move(open_.back());
    open_.pop_back();
    keys_.pop_back();
    return put(std::move(done));
  }

  std::string_view place_;
  const int* line_;
  std::vector<Tree> open_;
  std::vector<std::string> keys_;
  Tree root_;
};

}  // namespace

Tree parse_json(std::string_view text, std::string_view place) {
  int line = 1;
  Builder builder(place, &line);
  nlohmann::json::sax_parse(CountingIterator(text.data(), &line),
                            CountingIterator(text.data() + text.size(), &line), &builder);
  return builder.take();
}

}  // namespace atomcam
