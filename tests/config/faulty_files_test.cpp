// Every file of config/faulty with exactly the diagnostics that stand beside it;
// tests/write_generated.cpp writes them anew after a deliberate change of a message.
#include <gtest/gtest.h>

#include "config/controller_profile.h"
#include "config/read_rig.h"
#include "tests/config/generated_files.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using test::bytes_of, test::faulty_files, test::faulty_folder;

TEST(FaultyFiles, AreAtLeastFortyAndEachHasItsExpectation) {
  const auto files = faulty_files();
  EXPECT_GE(files.size(), 40U);
  for (fs::path file : files) EXPECT_TRUE(fs::exists(file.replace_extension(".expected"))) << file;
}

TEST(FaultyFiles, GetExactlyTheDiagnosticsBesideThem) {
  for (const fs::path& file : faulty_files()) {
    SCOPED_TRACE(file.filename().string());
    const test::FaultyOutcome outcome = test::read_faulty(file);
    const fs::path expected = fs::path(file).replace_extension(".expected");
    EXPECT_EQ(outcome.text, bytes_of(expected));
    EXPECT_FALSE(outcome.text.empty()) << "this file is said to be faulty";
    EXPECT_NE(outcome.has_value, outcome.has_error) << "a value and an error exclude each other";
  }
}

TEST(FaultyFiles, StandBesideABaseWithoutFault) {
  const auto rig = read_rig(faulty_folder() / "base" / "rig.toml");
  EXPECT_TRUE(rig.value);
  EXPECT_EQ(to_text(rig.diagnostics), "");
  const auto profile = read_profile(faulty_folder() / "base" / "controller.toml");
  EXPECT_TRUE(profile.value);
  EXPECT_EQ(to_text(profile.diagnostics), "");
}

}  // namespace
}  // namespace lightrig
