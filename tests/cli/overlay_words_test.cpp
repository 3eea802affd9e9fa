#include "cli/overlay_words.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lightrig::cli {
namespace {

TEST(OverlayWords, TellAScriptAllThatAPersonReads) {
  Plan plan;
  plan.shots.resize(4);
  plan.shots[3].held_out = true;
  ExpectedHighlights highlights;
  highlights.seen = {{0, {12.5, 7}, 0.01}};
  highlights.at_another_turn = {1, 3};
  highlights.lights_nothing = {2};
  const Json json = overlay_json("o.png", plan, highlights, {"wrong", "POSE: off by 2°"}, true);
  EXPECT_EQ(json["highlights"][0]["light"], "L01");
  ASSERT_EQ(json["not_drawn"].size(), 3U);
  EXPECT_EQ(json["not_drawn"][1]["light"], "H01");
  EXPECT_EQ(json["not_drawn"][2]["light"], "L03");
  const std::string words = not_drawn_words(plan, highlights);
  for (const Json& one : json["not_drawn"])
    EXPECT_THAT(words, testing::HasSubstr(one["why"].get<std::string>()));
  EXPECT_EQ(json["pose"]["verdict"], "wrong");
  EXPECT_EQ(json["pose"]["words"], "POSE: off by 2°");
  EXPECT_EQ(json["at_home"], true);
}

// Of a frame that the lamp did not light nothing is said, and no picture is looked at.
TEST(OverlayWords, JudgeNoPoseInTheDark) {
  const PoseSaid said = pose_said("no picture", {}, {}, {}, false);
  EXPECT_EQ(said.verdict, "not_told");
  EXPECT_THAT(said.words, testing::HasSubstr("--lamp"));
}

}  // namespace
}  // namespace lightrig::cli
