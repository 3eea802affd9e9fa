#include "daemon/service/rig_access.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

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

}  // namespace
}  // namespace lightrig
