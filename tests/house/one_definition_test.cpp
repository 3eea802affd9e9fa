// A name is one type in all of the product. Two types of one name in two files break the language's
// one-definition rule: nobody warns, and the linker takes either one's constructors for both.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/paths.h"

namespace {

namespace fs = std::filesystem;

/// Where each type outside of an anonymous namespace is defined, by its full name. Reads what
/// clang-format leaves: one opening of a namespace a line, its end marked by a comment.
void find_types(const fs::path& file, std::map<std::string, std::set<std::string>>& where) {
  static const std::regex opens(R"(^(?:inline )?namespace ?([\w:]*) ?\{)");
  static const std::regex closes(R"(^\}  // namespace)");
  static const std::regex type(
      R"(^(?:struct|class|enum class|enum|union) (?:\[\[[^\]]*\]\] )?((?:\w+::)*\w+)(?: final)?(?: :[^:].*)? \{)");
  std::vector<std::string> within;
  std::ifstream in(file);
  std::smatch found;
  for (std::string line; std::getline(in, line);) {
    if (std::regex_search(line, found, opens)) {
      within.push_back(found[1].str().empty() ? "(anonymous)" : found[1].str());
    } else if (std::regex_search(line, closes)) {
      if (!within.empty()) within.pop_back();
    } else if (std::regex_search(line, found, type)) {
      std::string name;
      for (const std::string& one : within) name += one + "::";
      if (name.find("(anonymous)") == std::string::npos) where[name + found[1].str()].insert(file);
    }
  }
}

TEST(OneDefinition, NoTwoTypesOfTheProductShareAName) {
  std::map<std::string, std::set<std::string>> where;
  for (const char* room : {"core", "config", "drivers", "sim", "daemon", "study", "cli"}) {
    for (const auto& entry :
         fs::recursive_directory_iterator(fs::path(lightrig::test::source_dir) / room)) {
      const fs::path file = entry.path();
      if (file.extension() == ".h" || file.extension() == ".cpp") find_types(file, where);
    }
  }
  EXPECT_GT(where.size(), 300U);
  for (const auto& [name, files] : where) {
    // A part that a build leaves out has a twin in its place, never beside it.
    std::set<std::string> beside;
    for (const std::string& file : files) {
      if (file.find("_absent.cpp") == std::string::npos) beside.insert(file);
    }
    EXPECT_LE(beside.size(), 1U) << name << ": " << testing::PrintToString(beside);
  }
}

}  // namespace
