// plan.json says what was planned, and gives it back to the last bit.
#include "daemon/session/plan_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/occlusion.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;
using testing::HasSubstr;

Shot some_shot(int candidate, bool held_out) {
  Shot shot;
  shot.candidate = candidate;
  shot.held_out = held_out;
  shot.light.p = Eigen::Vector3d(0.1, 1.0 / 3.0, 0.7);
  shot.gantry.axes = Eigen::Vector2d(1.0 / 7.0, -0.2);
  shot.exposures = {0.001, 1.0 / 300.0, 0.1};
  shot.selection = {.candidate = candidate,
                    .condition = 12.25,
                    .rank = 45,
                    .score = 12.25,
                    .new_cells = 80,
                    .predicted_error_percent = 5.0 / 3.0};
  return shot;
}

Prepared some_prepared() {
  Prepared prepared;
  prepared.candidates.resize(9);
  Plan& plan = prepared.plan;
  plan.stop = StopRule::count;
  plan.stop_value = 7;
  plan.shots = {some_shot(3, false), some_shot(8, false), some_shot(1, true)};
  plan.shots[0].selection.condition = std::numeric_limits<double>::infinity();
  plan.visit_order = {2, 0, 1};
  plan.mean_only_error_percent = 47.9;
  plan.predicted_capture_time = 61.25;
  plan.left_out.binning.rays_left_out = 123456789012;
  plan.left_out.candidates_unreachable = 480;
  plan.left_out.drivers_not_opened = {"modbus"};
  prepared.capture_by_lights = {30.5, 61.25};
  prepared.cost = {{"mesh", 0.5}, {"select", 0.25}};
  return prepared;
}

TEST(PlanJson, GivesBackEveryNumberOfThePlan) {
  const Prepared prepared = some_prepared();
  const auto plan = plan_from_json(plan_to_json({}, {}, prepared));
  ASSERT_TRUE(plan) << plan.error().message;
  ASSERT_EQ(plan->shots.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const Shot &was = prepared.plan.shots[i], &is = plan->shots[i];
    EXPECT_EQ(is.candidate, was.candidate);
    EXPECT_EQ(is.held_out, was.held_out);
    EXPECT_EQ(is.light.distant, was.light.distant);
    EXPECT_EQ(is.light.p, was.light.p);
    EXPECT_EQ(is.gantry.axes, was.gantry.axes);
    EXPECT_EQ(is.exposures, was.exposures);
    EXPECT_EQ(is.selection.condition, was.selection.condition);
    EXPECT_EQ(is.selection.predicted_error_percent, was.selection.predicted_error_percent);
  }
  EXPECT_EQ(plan->visit_order, prepared.plan.visit_order);
  EXPECT_EQ(plan->stop, StopRule::count);
  EXPECT_EQ(plan->predicted_capture_time, 61.25);
  EXPECT_EQ(plan->left_out.binning.rays_left_out, 123456789012);
  EXPECT_EQ(plan->left_out.drivers_not_opened, std::vector<std::string>{"modbus"});
}

TEST(PlanJson, OfASessionThatWasReplannedHoldsTheLightsAsTheyAreNow) {
  const Prepared before = some_prepared();
  Prepared after = before;
  ASSERT_GE(after.plan.shots.size(), 2U);
  after.plan.shots[1].light.p = {0.1, 0.2, 0.3};
  after.plan.shots[1].candidate = 0;
  std::ranges::reverse(after.plan.visit_order);
  const auto text = with_replanned(plan_to_json({}, {}, before), {replanned_json(after.plan, {1})});
  ASSERT_TRUE(text) << text.error().message;
  const auto plan = plan_from_json(*text);
  ASSERT_TRUE(plan) << plan.error().message;
  EXPECT_EQ(plan->shots[1].light.p, after.plan.shots[1].light.p);
  EXPECT_EQ(plan->shots[1].candidate, 0);
  EXPECT_EQ(plan->shots[0].light.p, before.plan.shots[0].light.p);
  EXPECT_EQ(plan->visit_order, after.plan.visit_order);
  EXPECT_FALSE(Json::parse(*text)["lights"][1].contains("index"));
  EXPECT_FALSE(with_replanned(plan_to_json({}, {}, before),
                              {Json{{"lights", {{{"index", 99}}}}, {"visit_order", {0}}}}));
}

TEST(PlanJson, KeepsTheNamesThatScriptsRelyOn) {
  const Json json = Json::parse(plan_to_json({}, {}, some_prepared()));
  EXPECT_EQ(json.at("schema"), "lightrig.plan/1");
  EXPECT_EQ(json.at("criterion"), "condition");
  EXPECT_TRUE(json.at("lights").at(0).at("condition").is_null());  // infinite
  EXPECT_EQ(json.at("lights").at(1).at("condition"), 12.25);
  for (const char* key : {"basis", "candidates", "visit_order", "left_out", "stop", "inputs"}) {
    EXPECT_TRUE(json.contains(key)) << key;
  }
  EXPECT_EQ(json.at("cost").at("plan_s"), 0.75);
  EXPECT_EQ(json.at("cost").at("predicted_capture_s"), 61.25);
  EXPECT_EQ(json.at("cost").at("predicted_capture_by_lights_s"), (Json{30.5, 61.25}));
}

struct Change {
  const char* pointer;
  Json value;
  const char* said;
};

TEST(PlanJson, WhatIsWrongIsNamedByItsPath) {
  const Json whole = Json::parse(plan_to_json({}, {}, some_prepared()));
  const std::vector<Change> changes{
      {"/schema", "lightrig.plan/9", "schema is not"},
      {"/criterion", "best", "criterion is \"best\", expected one of condition, a-optimal"},
      {"/lights/1/exposures_s", Json::array({0.0}), "lights[1].exposures_s holds an exposure"},
      {"/lights/1/gantry_axes/0", "x", "lights[1].gantry_axes[0] is not a number"},
      {"/lights/2/candidate", 9, "names candidate 9 of 9"},
      {"/visit_order", Json::array({0, 0, 1}), "visit_order names light 0"},
      {"/visit_order", Json::array({0, 1}), "visit_order names 2 of 3 lights"},
      {"/lights", Json::array(), "lights is empty"},
      {"/left_out/bins/rays_cast", Json(), "left_out.bins.rays_cast is not a whole number"},
  };
  for (const Change& change : changes) {
    Json damaged = whole;
    damaged[Json::json_pointer(change.pointer)] = change.value;
    const auto plan = plan_from_json(damaged.dump());
    ASSERT_FALSE(plan) << change.pointer;
    EXPECT_EQ(plan.error().code, ErrorCode::invalid_input);
    EXPECT_THAT(plan.error().message, HasSubstr(change.said));
  }
}

TEST(PlanJson, IsCalledByItsOwnNameAndPlace) {
  const auto plan = plan_from_json("{\n\"schema\": lightrig}", "p1.json");
  ASSERT_FALSE(plan);
  EXPECT_THAT(plan.error().message, HasSubstr("read p1.json: it is not JSON at line 2"));
  EXPECT_THAT(plan_from_json("{}", "p1.json").error().message,
              HasSubstr("read p1.json: schema is missing"));
}

TEST(PlanJson, CutAtAnyByteIsRefused) {
  const std::string text = plan_to_json({}, {}, some_prepared());
  for (std::size_t keep = 0; keep + 2 < text.size(); keep += 7) {
    EXPECT_FALSE(plan_from_json(text.substr(0, keep))) << keep;
  }
}

}  // namespace
}  // namespace lightrig
