#include "config/diagnostic.h"

#include <gtest/gtest.h>

#include <vector>

#include "config/suggest.h"

namespace lightrig {
namespace {

TEST(Diagnostic, ShowsTheLineAndACaretUnderTheColumn) {
  Diagnostic d;
  d.file = "rig.toml";
  d.line = 2;
  d.column = 5;
  d.length = 3;
  d.message = "wrong";
  d.suggestion = "did you mean \"right\"?";
  EXPECT_EQ(to_text(d, "first\nµ = bad\r\n"),
            "rig.toml:2:5: error: wrong; did you mean \"right\"?\n"
            "    2 | µ = bad\n"
            "      |     ^~~\n");
}

TEST(Diagnostic, OfAWholeFileHasNoLine) {
  Diagnostic d;
  d.file = "rig.toml";
  d.severity = Diagnostic::Severity::warning;
  d.message = "odd";
  EXPECT_EQ(to_text(d, "text"), "rig.toml: warning: odd\n");
}

TEST(Diagnostic, NeverUnderlinesBeyondItsLine) {
  Diagnostic d;
  d.file = "f";
  d.line = 1;
  d.column = 3;
  d.length = 99;
  d.message = "over the end";
  EXPECT_EQ(to_text(d, "abcd"), "f:1:3: error: over the end\n    1 | abcd\n      |   ^~\n");
}

TEST(Diagnostic, OfALongLineShowsWhatStandsAroundTheCaret) {
  Diagnostic d;
  d.file = "f";
  d.line = 1;
  d.column = 501;
  d.length = 4999;
  d.message = "id is \"" + std::string(5000, 'm') + "\"; it must be short";
  const std::string line = std::string(500, 'a') + std::string(5000, 'b');
  const std::string text = to_text(d, line);
  EXPECT_LT(text.size(), 1000U);
  EXPECT_NE(text.find("it must be short"), std::string::npos) << text;
  // 40 code points before the column, an ellipsis of one column before them, the caret under the b.
  const std::string shown = "    1 | …" + std::string(40, 'a') + std::string(120, 'b') + "…\n";
  EXPECT_NE(text.find(shown), std::string::npos) << text;
  EXPECT_NE(text.find("      | " + std::string(41, ' ') + "^~"), std::string::npos) << text;
}

// Worked by hand: one swap, one insertion, two replacements; case and "-" for "_" cost nothing.
TEST(EditDistance, CountsSwapsInsertionsAndReplacements) {
  EXPECT_EQ(edit_distance("raduis", "radius"), 1);
  EXPECT_EQ(edit_distance("radius", "radiuss"), 1);
  EXPECT_EQ(edit_distance("kitten", "sitten"), 1);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(edit_distance("A-Optimal", "a_optimal"), 0);
}

TEST(DidYouMean, IsSilentWhereNothingIsNear) {
  const std::vector<std::string> names = {"radius_m", "settle_s"};
  EXPECT_EQ(did_you_mean("radius_mm", names), "did you mean \"radius_m\"?");
  EXPECT_EQ(did_you_mean("radius", names), "did you mean \"radius_m\"?");
  EXPECT_EQ(did_you_mean("exposure", names), "");
  EXPECT_EQ(did_you_mean("", names), "");
}

}  // namespace
}  // namespace lightrig
