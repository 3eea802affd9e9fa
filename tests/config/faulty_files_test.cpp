// Every file of config/faulty with exactly the diagnostics that stand beside it. After a deliberate
// change of a message: LIGHTRIG_WRITE_EXPECTED=1 test_config --gtest_filter='*Faulty*', then read
// the difference before committing it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "config/controller_profile.h"
#include "config/read_rig.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

const fs::path folder = fs::path(lightrig::test::source_dir) / "config" / "faulty";

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// Where the checkout lies is no part of a message.
std::string without_folder(std::string text) {
  const std::string prefix = folder.string() + "/";
  for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix, at))
    text.erase(at, prefix.size());
  return text;
}

struct Outcome {
  std::string text;
  bool has_value = false, has_error = false;
};

template <class R>
Outcome outcome_of(const R& read) {
  return {without_folder(to_text(read.diagnostics)), read.value.has_value(),
          has_error(read.diagnostics)};
}

Outcome read_faulty(const fs::path& file) {
  const std::string name = file.filename().string();
  if (name.starts_with("profile_")) return outcome_of(read_profile(file));
  if (name.starts_with("rig_")) return outcome_of(read_rig(file));
  const Read<Rig> rig = read_rig(folder / "base" / "rig.toml");
  EXPECT_TRUE(rig.value) << to_text(rig.diagnostics);
  return rig.value ? outcome_of(read_session(file, *rig.value)) : Outcome{};
}

std::vector<fs::path> faulty_files() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

TEST(FaultyFiles, AreAtLeastFortyAndEachHasItsExpectation) {
  const auto files = faulty_files();
  EXPECT_GE(files.size(), 40U);
  if (std::getenv("LIGHTRIG_WRITE_EXPECTED") != nullptr)
    GTEST_SKIP() << "expectations are being written";
  for (fs::path file : files) EXPECT_TRUE(fs::exists(file.replace_extension(".expected"))) << file;
}

TEST(FaultyFiles, GetExactlyTheDiagnosticsBesideThem) {
  for (const fs::path& file : faulty_files()) {
    SCOPED_TRACE(file.filename().string());
    const Outcome outcome = read_faulty(file);
    const fs::path expected = fs::path(file).replace_extension(".expected");
    if (std::getenv("LIGHTRIG_WRITE_EXPECTED") != nullptr)
      std::ofstream(expected, std::ios::binary) << outcome.text;
    EXPECT_EQ(outcome.text, bytes_of(expected));
    EXPECT_FALSE(outcome.text.empty()) << "this file is said to be faulty";
    EXPECT_NE(outcome.has_value, outcome.has_error) << "a value and an error exclude each other";
  }
}

TEST(FaultyFiles, StandBesideABaseWithoutFault) {
  const auto rig = read_rig(folder / "base" / "rig.toml");
  EXPECT_TRUE(rig.value);
  EXPECT_EQ(to_text(rig.diagnostics), "");
  const auto profile = read_profile(folder / "base" / "controller.toml");
  EXPECT_TRUE(profile.value);
  EXPECT_EQ(to_text(profile.diagnostics), "");
}

}  // namespace
}  // namespace lightrig
