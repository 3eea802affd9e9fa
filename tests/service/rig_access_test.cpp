#include "daemon/service/rig_access.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <stop_token>
#include <utility>

#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {
namespace {

using ::testing::HasSubstr;

constexpr double degree = 0.017453292519943295;

GantryPosition at(double azimuth, double elevation) {
  GantryPosition position;
  position.axes = Eigen::Vector2d(azimuth * degree, elevation * degree);
  return position;
}

// A lamp on a dome of 0.8 m, and a sphere of 0.1 m where the dome meets azimuth 0, elevation 30.
TEST(RigAccess, JogsThroughTheObjectNoMoreThanASessionDoes) {
  const ScratchFolder folder;
  Rig rig = small_rig(folder.path());
  rig.gantry.solid.emplace();
  rig.gantry.solid->body.lamp_radius = 0.05;
  rig.gantry.solid->margin = 0.01;
  ObjectConfig object = rig.session_defaults.object;
  object.size = 0.1;
  object.world_from_object.translation() << 0.8 * std::cos(30 * degree), 0, 0.4;
  RigAccess access(rig, true, std::numeric_limits<double>::infinity());
  ASSERT_TRUE(access.open(object, {}));
  ASSERT_TRUE(access.home({}));
  ASSERT_TRUE(access.move_to(at(-40, 60), {}));
  ASSERT_TRUE(access.move_to(at(-40, 30), {}));
  const auto moved = access.move_to(at(40, 30), {});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::refused);
  EXPECT_THAT(moved.error().message, HasSubstr("the way leads through the object"));
  EXPECT_NEAR(access.facts({}).value().gantry.position.axes[0], -40 * degree, 1e-3);
  // The next session's object lies elsewhere.
  object.world_from_object.translation().setZero();
  access.set_object(object);
  EXPECT_TRUE(access.move_to(at(40, 30), {}));
}

/// Somebody else's hand is on the pendant.
struct Restless : Gantry {
  Result<void> home(const Until&) override { return {}; }
  Result<void> move_to(const GantryPosition&, const Until&) override { return {}; }
  Result<GantryStatus> status(const Until&) override {
    ++asked;
    GantryStatus status;
    status.position = at(0, 45);
    status.homed = true;
    status.at_rest = false;
    if (asked > alarm_after) status.alarm = "a limit switch";
    return status;
  }
  Result<void> clear_fault(const Until&) override { return {}; }

  int asked = 0, alarm_after = 1'000'000;
};

TEST(RigAccess, AnArmThatNeverComesToRestEndsArmingWithAMessageInTime) {
  const ScratchFolder folder;
  const Rig rig = small_rig(folder.path());
  RigAccess access(rig, true, std::numeric_limits<double>::infinity());
  ASSERT_TRUE(access.open(rig.session_defaults.object, {}));
  auto arm = std::make_unique<Restless>();
  Restless& restless = *arm;
  access.devices().gantry = std::move(arm);
  const TimePoint begin = access.clock().now();
  const auto facts = access.facts_at_rest({});
  const auto took = access.clock().now() - begin;
  ASSERT_FALSE(facts);
  EXPECT_EQ(facts.error().code, ErrorCode::refused);
  EXPECT_THAT(facts.error().message, HasSubstr("has not come to rest within 10 s"));
  EXPECT_THAT(facts.error().message, HasSubstr("another program or a pendant"));
  EXPECT_GE(took, std::chrono::seconds(10));
  EXPECT_GT(restless.asked, 100);  // it was watched, and would have been seen at rest

  // What has to be put right first anyhow is said without waiting, and a stop is heeded.
  restless.asked = 0;
  restless.alarm_after = 3;
  EXPECT_EQ(access.facts_at_rest({}).value().gantry.alarm, "a limit switch");
  EXPECT_EQ(restless.asked, 4);
  restless.asked = 0;
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(access.facts_at_rest(stop.get_token()).error().code, ErrorCode::stopped);
  EXPECT_LE(restless.asked, 1);
}

}  // namespace
}  // namespace lightrig
