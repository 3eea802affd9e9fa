#include "cli/findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lightrig::cli {
namespace {

using ::testing::HasSubstr;

Findings two_that_passed_and(const Finding& third) {
  Findings findings;
  findings.add("homing", "it is homed", passed("in 3 s"), "2026-11-22T00:00:00Z");
  findings.add("lamp off", "it is disarmed", passed("dark"), "2026-11-22T00:00:01Z");
  findings.add("watchdog of the drives", "it is held", third, "2026-11-22T00:00:02Z");
  return findings;
}

TEST(Findings, OfARigThatProvesEverythingArePassed) {
  const Findings findings = two_that_passed_and(passed("alarm"));
  EXPECT_EQ(findings.json()["passed"], true);
  EXPECT_TRUE(findings.all_it_has());
  EXPECT_EQ(findings.verdict(), "3 of 3 checks passed");
}

// Found: a rig whose drives have no watchdog was recorded as passed, without a word.
TEST(Findings, OfARigThatLacksAProtectionAreNoPassAndNameIt) {
  const Findings findings = two_that_passed_and(absent("they have none"));
  const Json record = findings.json();
  EXPECT_EQ(record["passed"], false);
  EXPECT_EQ(record["absent"], Json{"watchdog of the drives"});
  EXPECT_TRUE(record["not_proven"].empty());
  EXPECT_TRUE(findings.all_it_has()) << "what it has got is proven";
  EXPECT_THAT(findings.verdict(),
              HasSubstr("2 of 3 checks passed; absent: watchdog of the drives"));
}

TEST(Findings, OfWhatNobodySawOrWhatFailedNameIt) {
  const Findings unseen = two_that_passed_and(not_proven("nobody was asked"));
  EXPECT_EQ(unseen.json()["passed"], false);
  EXPECT_EQ(unseen.json()["not_proven"], Json{"watchdog of the drives"});
  EXPECT_FALSE(unseen.all_it_has());
  const Findings broken = two_that_passed_and(failed("it went on"));
  EXPECT_EQ(broken.json()["failed"], Json{"watchdog of the drives"});
  EXPECT_FALSE(broken.all_it_has());
  EXPECT_THAT(broken.verdict(), HasSubstr("FAILED: watchdog of the drives"));
}

}  // namespace
}  // namespace lightrig::cli
