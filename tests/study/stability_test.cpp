#include "study/stability.h"

#include <gtest/gtest.h>

namespace lightrig {
namespace {

const StabilityReport& report() {
  static const StabilityReport once = run_stability();
  return once;
}

class StabilitySubject : public ::testing::TestWithParam<const char*> {};

TEST_P(StabilitySubject, AgreesWithHighPrecisionOnEveryStiffOrExtremeCase) {
  int cases = 0;
  for (const StabilityCase& c : report().cases) {
    if (c.group != GetParam()) continue;
    ++cases;
    EXPECT_TRUE(c.pass) << c.name << ": " << c.value << " against " << c.reference
                        << ", relative error " << c.relative_error << ", at most " << c.tolerance;
  }
  EXPECT_GT(cases, 0);
}

INSTANTIATE_TEST_SUITE_P(Stability, StabilitySubject,
                         ::testing::Values("condition", "posterior", "angles", "planner",
                                           "geometry", "materials", "fit", "bracket", "motion",
                                           "route"),
                         [](const auto& subject) { return std::string(subject.param); });

TEST(Stability, SaysWhereTheNaiveFormulaIsWrong) {
  // The eigenvalues of GᵀG at a condition number of 1e20: no digit is right, nor always the sign.
  int hopeless = 0;
  for (const StabilityCase& c : report().cases) {
    if (c.group == "condition" && c.pass && c.naive &&
        !(std::abs(*c.naive / c.reference - 1) < 0.5))
      ++hopeless;
  }
  EXPECT_GE(hopeless, 3);
}

TEST(Stability, SaysNothingOfANaiveFormulaWhereThereIsNone) {
  StabilityReport few;
  for (const StabilityCase& c : report().cases)
    if (c.name == "coincident stops: each is visited once" || c.name.starts_with("MAP of zeros"))
      few.cases.push_back(c);
  ASSERT_EQ(few.cases.size(), 2U);
  EXPECT_TRUE(std::isnan(few.cases[0].naive.value()));  // the logarithm of a negative number
  EXPECT_FALSE(few.cases[1].naive);
  EXPECT_NE(stability_text(few).find(" –  ok"), std::string::npos);
  EXPECT_NE(stability_json(few).find("\"naive\": null"), std::string::npos);
}

TEST(Stability, TextAndJsonHoldEveryCase) {
  const std::string text = stability_text(report()), json = stability_json(report());
  for (const StabilityCase& c : report().cases) {
    EXPECT_NE(text.find(c.name), std::string::npos);
    EXPECT_NE(json.find("\"" + c.name + "\""), std::string::npos);
  }
  EXPECT_NE(text.find("failed=" + std::to_string(report().failed())), std::string::npos);
}

}  // namespace
}  // namespace lightrig
