// The table of docs/defects.md names tests; each must be there.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

namespace {

std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

void add_cpp_tests(const std::string& text, std::set<std::string>& names) {
  const std::regex test(R"((?:TEST|TEST_P|TEST_F)\(\s*(\w+)\s*,\s*(\w+)\s*\))");
  for (std::sregex_iterator match(text.begin(), text.end(), test), end; match != end; ++match)
    names.insert((*match)[1].str() + "." + (*match)[2].str());
}

void add_python_tests(const std::string& text, std::set<std::string>& names) {
  const std::regex line(R"(class (\w+)\(unittest|\n    def (test_\w+)\(self)");
  std::string suite;
  for (std::sregex_iterator match(text.begin(), text.end(), line), end; match != end; ++match) {
    if ((*match)[1].matched)
      suite = (*match)[1].str();
    else
      names.insert(suite + "." + (*match)[2].str());
  }
}

/// "Suite.Name" of every test written in the tree's sources.
std::set<std::string> written_tests() {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(ATOMCAM_SOURCE_DIR "/tests")) {
    if (entry.path().extension() == ".cpp") add_cpp_tests(text_of(entry.path()), names);
    if (entry.path().extension() == ".py") add_python_tests(text_of(entry.path()), names);
  }
  return names;
}

TEST(Defects, EveryNamedTestIsThere) {
  const std::set<std::string> written = written_tests();
  const std::string document = text_of(ATOMCAM_SOURCE_DIR "/docs/defects.md");
  const std::regex named(R"(`([A-Z]\w+\.(?:[A-Z]|test_)\w+)`)");
  int count = 0;
  for (std::sregex_iterator match(document.begin(), document.end(), named), end; match != end;
       ++match, ++count)
    EXPECT_TRUE(written.contains((*match)[1].str())) << (*match)[1].str();
  EXPECT_GT(count, 30);
  EXPECT_TRUE(document.find("`Cameras.test_") != std::string::npos);  // Python's are among them
  EXPECT_FALSE(written.contains("Defects.NobodyWroteThis"));
}

}  // namespace
