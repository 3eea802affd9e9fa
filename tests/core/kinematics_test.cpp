// Gantries beside the dome: where the lamp is, how it points, what turns.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "core/gantry_model.h"
#include "core/half_diff.h"
#include "core/route.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

struct Random {
  std::mt19937 engine{5};
  double between(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(engine);
  }
};

GantryPosition position_of(std::initializer_list<double> axes) {
  GantryPosition p;
  p.axes.resize(static_cast<Eigen::Index>(axes.size()));
  std::copy(axes.begin(), axes.end(), p.axes.begin());
  return p;
}

GantryPosition anywhere(const GantryModel& gantry, Random& random) {
  GantryPosition p;
  p.axes.resize(static_cast<Eigen::Index>(gantry.axes.size()));
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const double value = random.between(gantry.axes[i].min, gantry.axes[i].max);
    p.axes[static_cast<Eigen::Index>(i)] = gantry.axes[i].selector ? std::round(value) : value;
  }
  return p;
}

GantryModel cartesian(bool head) {
  GantryModel gantry;
  gantry.kinematics =
      CartesianKinematics{{-0.5, -0.4, 0.1}, -Eigen::Vector3d::UnitZ(), head, {0.02, 0.01, 0.05}};
  for (const char* name : {"x", "y", "z"}) gantry.axes.push_back({name, false, 0, 1, 0.1, 0.2, 0});
  if (head) {
    gantry.axes.push_back({"pan", true, -pi, pi, 1, 2, 0});
    gantry.axes.push_back({"tilt", true, -pi / 2, pi / 2, 1, 2, 0});
  }
  gantry.tolerance = gantry.linear_tolerance = 1e-4;
  gantry.lobe.exponent = 3;
  return gantry;
}

GantryModel turntable(bool arm) {
  GantryModel gantry;
  TurntableKinematics table;
  table.centre = {0.05, -0.02, 0.1};
  table.radius = 0.7;
  table.azimuth = 0.4;
  table.elevation = 0.6;
  table.arm = arm;
  gantry.kinematics = table;
  gantry.axes = {{"turn", true, 0, 2 * pi, 1, 2, 0}};
  if (arm) gantry.axes.push_back({"elevation", true, -0.1, 1.5, 0.5, 1, 0});
  gantry.tolerance = 1e-4;
  return gantry;
}

GantryModel lamps() {
  GantryModel gantry;
  gantry.kinematics = FixedLampsKinematics{
      {{0.5, 0, 0.5}, {0, 0.6, 0.3}, {-0.4, 0.1, 0.7}, {0, 0, 0.9}}, {0, 0, 0.1}};
  gantry.axes = {{"lamp", false, 0, 3, 1, 1, 0, true}};
  return gantry;
}

TEST(Kinematics, ReachIsTheInverseOfLightAtForEveryKind) {
  Random random;
  for (const GantryModel& gantry : {cartesian(false), cartesian(true), turntable(true), lamps()}) {
    for (int i = 0; i < 500; ++i) {
      const LightPosition light = light_at(gantry, anywhere(gantry, random));
      const auto reached = reach(gantry, light.p);
      ASSERT_TRUE(reached);
      EXPECT_TRUE(within_limits(gantry, *reached));
      EXPECT_LT((light_at(gantry, *reached).p - light.p).norm(), 1e-12);
    }
  }
}

TEST(Kinematics, AHeadOnLinearAxesPointsAtItsTarget) {
  const GantryModel gantry = cartesian(true);
  const auto reached = reach(gantry, {0.3, 0.2, 0.8});
  ASSERT_TRUE(reached);
  const LightPosition light = light_at(gantry, *reached);
  const Eigen::Vector3d target(0.02, 0.01, 0.05);
  EXPECT_LT((light.aim - (target - light.p).normalized()).norm(), 1e-12);
  EXPECT_NEAR(light.emission(target), 1, 1e-12);
  EXPECT_FALSE(reach(gantry, {0.3, 0.2, 1.2}));  // z would be 1.1 m of 1
}

TEST(Kinematics, ACosineLobeLightsByThePowerOfTheCosineAndNothingBehind) {
  // Straight down from 0.5 m; at 0.5 m aside the angle is 45° and the distance √½ m: worked by hand
  // cos³ 45° / ½ = 0.7071.
  const GantryModel gantry = cartesian(false);
  const LightPosition light = light_at(gantry, position_of({0.5, 0.4, 0.4}));
  EXPECT_LT((light.p - Eigen::Vector3d(0, 0, 0.5)).norm(), 1e-15);
  EXPECT_NEAR(light.falloff({0, 0, 0}), 4, 1e-12);
  EXPECT_NEAR(light.falloff({0.5, 0, 0}), std::sqrt(0.5), 1e-12);
  EXPECT_EQ(light.emission({0, 0, 1}), 0);
  EXPECT_FALSE(light.reaches({0, 0, 1}));
}

TEST(Kinematics, ATableOfALobeIsLinearBetweenItsAngles) {
  EmissionLobe lobe;
  lobe.angle = {0, 0.2, 0.5};
  lobe.intensity = {1, 0.8, 0.2};
  EXPECT_NEAR(lobe.towards(std::cos(0.1)), 0.9, 1e-12);
  EXPECT_NEAR(lobe.towards(std::cos(0.35)), 0.5, 1e-12);
  EXPECT_EQ(lobe.towards(std::cos(0.51)), 0);
  EXPECT_FALSE(lobe.uniform());
}

// What the object sees, computed with the object left and everything else turned, against the
// object turned and everything else left.
TEST(Kinematics, ATurnedObjectsAnglesAreThoseOfTheWorldInWhichItTurns) {
  const GantryModel gantry = turntable(true);
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 700;
  camera.cx = 320;
  camera.cy = 240;
  camera.distortion = {-0.1, 0.02, 0.001, 0, 0};
  camera.camera_from_world = look_at({0.2, -1, 0.6}, {0, 0, 0.1}, Eigen::Vector3d::UnitZ());
  Random random;
  const Eigen::Vector3d centre(0.05, -0.02, 0.1);
  for (int trial = 0; trial < 300; ++trial) {
    const GantryPosition at = anywhere(gantry, random);
    const Eigen::Vector3d x(random.between(-0.1, 0.1), random.between(-0.1, 0.1),
                            random.between(0, 0.2));
    const Eigen::Vector3d n =
        Eigen::Vector3d(random.between(-1, 1), random.between(-1, 1), random.between(-1, 1))
            .normalized();
    // The world: x turned about the vertical through the centre, counter-clockwise from above.
    const double c = std::cos(at.axes[0]), s = std::sin(at.axes[0]);
    Eigen::Matrix3d turn;
    turn << c, -s, 0, s, c, 0, 0, 0, 1;
    const Eigen::Vector3d world_x = centre + turn * (x - centre), world_n = turn * n;
    const double e = at.axes[1];
    const Eigen::Vector3d lamp =
        centre + 0.7 * Eigen::Vector3d(std::cos(e) * std::cos(0.4), std::cos(e) * std::sin(0.4),
                                       std::sin(e));
    const CameraModel seen = camera_at(gantry, camera, at);
    EXPECT_LT((project(seen, x) - project(camera, world_x)).norm(), 1e-9);
    const LightPosition light = light_at(gantry, at);
    EXPECT_NEAR(light.falloff(x), 1 / (lamp - world_x).squaredNorm(), 1e-12);
    const Eigen::Vector3d wi = (lamp - world_x).normalized();
    const Eigen::Vector3d wo = view_direction(camera, world_x);
    if (n.dot(light.direction_from(x)) < 0.05 || n.dot(view_direction(seen, x)) < 0.05) continue;
    const HalfDiff turned = half_diff(n, light.direction_from(x), view_direction(seen, x));
    const HalfDiff world = half_diff(world_n, wi, wo);
    EXPECT_NEAR(turned.theta_h, world.theta_h, 1e-9);
    EXPECT_NEAR(turned.theta_d, world.theta_d, 1e-9);
  }
}

TEST(Kinematics, ForTheCameraATurntablesFixedLampNeverMoves) {
  // The light's direction in the camera's frame is one and the same at every turn: turning shows
  // other normals, and no other angle between lamp and camera.
  const GantryModel gantry = turntable(false);
  CameraModel camera;
  camera.camera_from_world = look_at({0, -1, 0.5}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  const auto in_camera = [&](double turn) {
    const GantryPosition at = position_of({turn});
    return Eigen::Vector3d(camera_at(gantry, camera, at).camera_from_world *
                           light_at(gantry, at).p);
  };
  for (const double turn : {0.3, 1.7, 4.0, 6.1})
    EXPECT_LT((in_camera(turn) - in_camera(0)).norm(), 1e-12);
  EXPECT_TRUE(turns_object(gantry));
  EXPECT_FALSE(turns_object(lamps()));
}

TEST(Kinematics, FixedLampsSwitchInNoTimeAndHaveNoLampBetweenTwo) {
  const GantryModel gantry = lamps();
  EXPECT_EQ(move_time(gantry, position_of({0}), position_of({3})), 0);
  EXPECT_EQ(move_position(gantry, position_of({0}), position_of({3}), 0.1).axes[0], 3);
  EXPECT_FALSE(within_limits(gantry, position_of({1.5})));
  EXPECT_FALSE(within_limits(gantry, position_of({4})));
  EXPECT_FALSE(reach(gantry, {0.5, 0, 0.4999}));
  const std::vector<GantryPosition> stops{position_of({2}), position_of({1}), position_of({3})};
  const auto order = order_route(gantry, position_of({0}), stops);
  EXPECT_EQ(order.size(), 3U);
  EXPECT_EQ(route_time(gantry, position_of({0}), stops, order), 0);
  EXPECT_EQ(value_text(gantry.axes[0], 2, 3), "lamp 3");
}

TEST(Kinematics, LinearAxesTakeTheTimeOfTheSlowest) {
  // 0.1 m/s, 0.2 m/s²: half a second and 25 mm for each ramp; 0.45 m takes 0.5 + 4 + 0.5 s.
  const GantryModel gantry = cartesian(false);
  EXPECT_NEAR(move_time(gantry, position_of({0, 0, 0}), position_of({0.2, 0.45, 0})), 5, 1e-12);
  EXPECT_EQ(value_text(gantry.axes[0], 0.0125, 4), "12.500 mm");
  GantryPosition near = position_of({0.2, 0.45, 0});
  near.axes[2] += 0.9e-4;
  EXPECT_TRUE(arrived(gantry, near, position_of({0.2, 0.45, 0})));
  near.axes[2] += 0.2e-4;
  EXPECT_FALSE(arrived(gantry, near, position_of({0.2, 0.45, 0})));
}

}  // namespace
}  // namespace lightrig
