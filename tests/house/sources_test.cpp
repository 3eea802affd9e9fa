// The sources that the code names in brackets are those that docs/sources.md lists.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// "Ali 2013" of "Ali 2013, eq. 3"; two keys in one pair of brackets are parted by a semicolon.
std::set<std::string> keys_in(const std::string& text) {
  static const std::regex bracket(R"re(\[([A-Z][^\[\]{}()"]{1,120})\])re");
  static const std::regex key(R"(^\s*((RFC|IEC) [0-9-]+|[^;]*?\b(18|19|20)[0-9]{2}\b))");
  std::set<std::string> keys;
  for (std::sregex_iterator it(text.begin(), text.end(), bracket), end; it != end; ++it) {
    // A citation that a comment's line break divides.
    std::string inner = std::regex_replace((*it)[1].str(), std::regex(R"(\s*\n\s*//+<?\s*)"), " ");
    for (std::size_t from = 0; from != std::string::npos;) {
      const std::size_t semicolon = inner.find(';', from);
      const std::string one = inner.substr(from, semicolon - from);
      std::smatch found;
      if (std::regex_search(one, found, key)) keys.insert(found[1].str());
      from = semicolon == std::string::npos ? semicolon : semicolon + 1;
    }
  }
  return keys;
}

TEST(Sources, EveryCitationInTheCodeIsListed) {
  const fs::path root = test::source_dir;
  const std::string listed = text_of(root / "docs" / "sources.md");
  ASSERT_FALSE(listed.empty());
  std::size_t cited = 0;
  for (const char* room : {"core", "config", "drivers", "sim", "daemon", "study", "cli"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / room)) {
      const auto extension = entry.path().extension();
      if (extension != ".cpp" && extension != ".h") continue;
      for (const std::string& key : keys_in(text_of(entry.path()))) {
        ++cited;
        EXPECT_NE(listed.find("**[" + key + "]**"), std::string::npos)
            << entry.path().lexically_relative(root) << " cites [" << key << "]";
      }
    }
  }
  EXPECT_GT(cited, 100U);
}

}  // namespace
}  // namespace lightrig
