#include "core/gantry_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

GantryModel dome() {
  GantryModel gantry;
  DomeKinematics kinematics;
  kinematics.centre = {0.1, -0.2, 0.3};
  kinematics.radius = 0.8;
  gantry.kinematics = kinematics;
  gantry.axes = {{"azimuth", true, -1.1 * pi, 1.5 * pi, 0.6, 1.2, 0.0},
                 {"elevation", true, -0.2, 1.4, 0.3, 0.9, 0.5}};
  gantry.tolerance = 1e-4;
  return gantry;
}

GantryPosition at(double a, double e) {
  GantryPosition position;
  position.axes = Eigen::Vector2d(a, e);
  return position;
}

TEST(GantryModel, ReachIsTheInverseOfLightAt) {
  for (const bool distant_lamp : {false, true}) {
    GantryModel gantry = dome();
    gantry.distant_lamp = distant_lamp;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> a(-1.1 * pi, 1.5 * pi), e(-0.2, 1.4);
    for (int i = 0; i < 1000; ++i) {
      const LightPosition light = light_at(gantry, at(a(random), e(random)));
      const auto reached = reach(gantry, light.p);
      ASSERT_TRUE(reached);
      EXPECT_TRUE(within_limits(gantry, *reached));
      EXPECT_LT((light_at(gantry, *reached).p - light.p).norm(), 1e-12);
      EXPECT_EQ(light.distant, distant_lamp);
    }
  }
}

TEST(GantryModel, ReachAddsWholeTurnsWhereTheTravelHasThem) {
  GantryModel gantry = dome();
  gantry.axes[0].min = 0.5 * pi;
  gantry.axes[0].max = 2.25 * pi;
  gantry.axes[0].home = pi;
  // Azimuth −90° is in this travel only as 270°.
  const auto reached = reach(gantry, Eigen::Vector3d(0.1, -0.2 - 0.8, 0.3));
  ASSERT_TRUE(reached);
  EXPECT_NEAR(reached->axes[0], 1.5 * pi, 1e-12);
  // 22.5° is nearer to home as 382.5° is not: only 382.5° is in travel.
  const double a = pi / 8;
  const auto second =
      reach(gantry, Eigen::Vector3d(0.1 + 0.8 * std::cos(a), -0.2 + 0.8 * std::sin(a), 0.3));
  ASSERT_TRUE(second);
  EXPECT_NEAR(second->axes[0], a + 2 * pi, 1e-12);
  // 67.5° is in no turn of it.
  const double b = 3 * pi / 8;
  EXPECT_FALSE(
      reach(gantry, Eigen::Vector3d(0.1 + 0.8 * std::cos(b), -0.2 + 0.8 * std::sin(b), 0.3)));
}

TEST(GantryModel, AnArcThatSwingsOverTheZenithReachesTheFarSide) {
  GantryModel gantry = dome();
  gantry.axes[0].min = -0.1;
  gantry.axes[0].max = 0.1;
  gantry.axes[1].max = pi + 0.2;
  const Eigen::Vector3d far_side(0.1 - 0.8 * std::cos(0.4), -0.2, 0.3 + 0.8 * std::sin(0.4));
  const auto reached = reach(gantry, far_side);
  ASSERT_TRUE(reached);
  EXPECT_NEAR(reached->axes[0], 0, 1e-12);
  EXPECT_NEAR(reached->axes[1], pi - 0.4, 1e-12);
}

TEST(GantryModel, OutOfTravelOffTheDomeAndNotFiniteAreNotReached) {
  const GantryModel gantry = dome();
  const Eigen::Vector3d centre(0.1, -0.2, 0.3);
  EXPECT_FALSE(reach(gantry, centre + Eigen::Vector3d(0, 0, 0.8)));  // zenith: elevation 90° > 80°
  EXPECT_FALSE(reach(gantry, centre + Eigen::Vector3d(0.79, 0, 0)));
  EXPECT_FALSE(reach(gantry, centre));
  EXPECT_FALSE(reach(gantry, Eigen::Vector3d::Constant(std::nan(""))));
  EXPECT_FALSE(within_limits(gantry, at(std::nan(""), 0)));
  EXPECT_FALSE(within_limits(gantry, at(0, 1.4000001)));
  EXPECT_TRUE(within_limits(gantry, at(0, 1.4)));
}

TEST(GantryModel, MoveTimesAreTheTextbookTrapezoidAndTriangle) {
  const GantryModel gantry = dome();
  // Worked by hand. Azimuth 0.6 rad/s, 1.2 rad/s²: ramps 0.5 s and 0.15 rad each.
  EXPECT_NEAR(move_time(gantry, at(0, 0), at(1.5, 0)), 0.5 + 2.0 + 0.5, 1e-12);
  EXPECT_NEAR(move_time(gantry, at(0, 0), at(0.075, 0)), 0.5, 1e-12);  // 2 √(0.075/1.2)
  EXPECT_NEAR(move_time(gantry, at(1, 0), at(1, 0)), 0, 0);
  // Elevation 0.3 rad/s, 0.9 rad/s²: 0.6 rad takes 2 + 1/3 s, longer than azimuth's 1.5 s.
  EXPECT_NEAR(move_time(gantry, at(0, 0), at(0.6, 0.6)), 2 + 1.0 / 3, 1e-12);
}

TEST(GantryModel, MovesKeepSpeedAndAccelerationLimitsAndArriveTogether) {
  const GantryModel gantry = dome();
  std::mt19937 random(4);
  std::uniform_real_distribution<double> a(-3, 4), e(-0.2, 1.4);
  for (int trial = 0; trial < 200; ++trial) {
    const GantryPosition from = at(a(random), e(random)), to = at(a(random), e(random));
    const double total = move_time(gantry, from, to);
    EXPECT_EQ(move_position(gantry, from, to, 0).axes, from.axes);
    EXPECT_EQ(move_position(gantry, from, to, total).axes, to.axes);
    const int steps = 400;
    const double dt = total / steps;
    bool some_axis_works_hard = false;
    for (int i = 1; i + 1 < steps; ++i) {
      const AxisValues p0 = move_position(gantry, from, to, (i - 1) * dt).axes;
      const AxisValues p1 = move_position(gantry, from, to, i * dt).axes;
      const AxisValues p2 = move_position(gantry, from, to, (i + 1) * dt).axes;
      for (Eigen::Index k = 0; k < 2; ++k) {
        const Axis& axis = gantry.axes[static_cast<std::size_t>(k)];
        const double speed = std::abs(p1[k] - p0[k]) / dt;
        const double acceleration = std::abs(p2[k] - 2 * p1[k] + p0[k]) / (dt * dt);
        EXPECT_LE(speed, axis.max_speed * (1 + 1e-9));
        EXPECT_LE(acceleration, axis.max_acceleration * (1 + 1e-6));
        some_axis_works_hard |= acceleration > 0.99 * axis.max_acceleration;
      }
      // A straight line in axis space: both axes have done the same share of their way.
      const AxisValues way = to.axes - from.axes, done = p1 - from.axes;
      EXPECT_NEAR(way[0] * done[1], way[1] * done[0], 1e-9);
    }
    EXPECT_TRUE(some_axis_works_hard);
  }
}

}  // namespace
}  // namespace lightrig
