#include "core/half_diff.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <bit>
#include <cmath>
#include <numbers>
#include <random>

#include "core/bivariate_grid.h"
#include "core/cell_lookup.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Eigen::Vector3d unit(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return Eigen::Vector3d(x, y, z).normalized();
}

Eigen::Vector3d above(std::mt19937_64& random, const Eigen::Vector3d& n) {
  const Eigen::Vector3d w = unit(random);
  return w.dot(n) < 0 ? Eigen::Vector3d(-w) : w;
}

TEST(HalfDiff, AMillionSeededAnglesComeBackFromTheirDirections) {
  std::mt19937_64 random(1);
  double worst_h = 0, worst_d = 0, worst_phi = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    const HalfDiff angles{uniform(random, 0, pi / 2), uniform(random, 1e-6, pi / 2 - 1e-6),
                          uniform(random, 0, pi)};
    const DirectionPair pair = directions(angles);
    const HalfDiff back = half_diff(Eigen::Vector3d::UnitZ(), pair.wi, pair.wo);
    worst_h = std::max(worst_h, std::abs(back.theta_h - angles.theta_h));
    worst_d = std::max(worst_d, std::abs(back.theta_d - angles.theta_d));
    // The azimuth is known as well as the two directions it turns about are apart; 0 and π are one.
    double phi = std::abs(back.phi_d - angles.phi_d);
    phi = std::min(phi, pi - phi);
    worst_phi = std::max(worst_phi, phi * std::sin(angles.theta_d) * std::sin(angles.theta_h));
  }
  // cos θd scales the half vector's rounding: at θd = π/2 − 1e-6 it is 1e-6 long.
  EXPECT_LT(worst_h, 1e-9);
  EXPECT_LT(worst_d, 1e-15);
  EXPECT_LT(worst_phi, 1e-9);
}

TEST(HalfDiff, ExchangingLightAndCameraChangesNothing) {
  std::mt19937_64 random(2);
  for (int i = 0; i < 100'000; ++i) {
    const Eigen::Vector3d n = unit(random), l = above(random, n), v = above(random, n);
    const HalfDiff a = half_diff(n, l, v), b = half_diff(n, v, l);
    ASSERT_EQ(a.theta_h, b.theta_h);
    ASSERT_EQ(a.theta_d, b.theta_d);
    const double phi = std::abs(a.phi_d - b.phi_d);
    ASSERT_LT(std::min(phi, pi - phi), 1e-12);
  }
}

TEST(HalfDiff, TurningAllThreeDirectionsTogetherChangesNothing) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 100'000; ++i) {
    const Eigen::Vector3d n = unit(random), l = above(random, n), v = above(random, n);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(uniform(random, 0, 2 * pi), unit(random)).toRotationMatrix();
    const HalfDiff a = half_diff(n, l, v), b = half_diff(turn * n, turn * l, turn * v);
    ASSERT_NEAR(a.theta_h, b.theta_h, 1e-11 / std::cos(a.theta_d));
    ASSERT_NEAR(a.theta_d, b.theta_d, 1e-14);
  }
}

TEST(HalfDiff, AMirrorConfigurationHasItsHalfVectorOnTheNormal) {
  const double t = 0.7;
  const HalfDiff angles = half_diff(Eigen::Vector3d::UnitZ(), {std::sin(t), 0, std::cos(t)},
                                    {-std::sin(t), 0, std::cos(t)});
  EXPECT_EQ(angles.theta_h, 0);
  EXPECT_NEAR(angles.theta_d, t, 1e-16);
}

TEST(HalfDiff, TinyHalfAnglesKeepTheirDigits) {
  // Light straight above, camera 2ε aside: the half vector leans by ε. acos(n·h) would say 0.
  for (const double e : {1e-3, 1e-5, 1e-7, 1e-9, 1e-12, 1e-15}) {
    const HalfDiff angles = half_diff(Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitZ(),
                                      {std::sin(2 * e), 0, std::cos(2 * e)});
    EXPECT_NEAR(angles.theta_h / e, 1, 1e-15 / e + 1e-12) << e;
    EXPECT_NEAR(angles.theta_d / e, 1, 1e-9) << e;
  }
}

TEST(HalfDiff, DirectionsNearlyOppositeKeepTheirDifferenceAngle) {
  for (const double e : {1e-3, 1e-6, 1e-9, 1e-12}) {
    const HalfDiff angles = half_diff(Eigen::Vector3d::UnitZ(), {std::cos(e), 0, std::sin(e)},
                                      {-std::cos(e), 0, std::sin(e)});
    EXPECT_NEAR((pi / 2 - angles.theta_d) / e, 1, 3e-16 / e + 1e-12) << e;
    EXPECT_EQ(angles.theta_h, 0) << e;
  }
}

TEST(BivariateGrid, CellCentresLieInTheirCells) {
  for (const BivariateGrid grid :
       {BivariateGrid{90, 90}, BivariateGrid{1, 1}, BivariateGrid{7, 3}, BivariateGrid{256, 64}}) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      ASSERT_EQ(cell_of(grid, cell_centre(grid, cell)), cell);
      ASSERT_TRUE(reachable(grid, cell));
    }
  }
}

TEST(BivariateGrid, TheFirstRowIsAHundredthOfADegreeWide) {
  const BivariateGrid grid;
  EXPECT_EQ(row_of_theta_h(grid, 0.0111 * pi / 180), 0);
  EXPECT_EQ(row_of_theta_h(grid, 0.0112 * pi / 180), 1);
  EXPECT_EQ(cell_of(grid, {pi / 2, pi / 2, 0}), grid.cells() - 1);
}

TEST(CellLookup, EqualsTheAnglesCellOnAMillionSeededDirections) {
  std::mt19937_64 random(4);
  for (const BivariateGrid grid : {BivariateGrid{90, 90}, BivariateGrid{333, 17}}) {
    const CellLookup lookup(grid);
    for (int i = 0; i < 500'000; ++i) {
      const Eigen::Vector3d n = unit(random), l = above(random, n), v = above(random, n);
      ASSERT_EQ(lookup(n, l, v), cell_of(grid, half_diff(n, l, v)));
    }
  }
}

TEST(CellLookup, EqualsTheAnglesCellWithinAHundredDoublesOfEveryLine) {
  const BivariateGrid grid;
  const CellLookup lookup(grid);
  for (int i = 1; i < 90; ++i) {
    const double theta_h = pi / 2 * (i / 90.0) * (i / 90.0);
    const double chord2 = 4 * std::sin(theta_h / 2) * std::sin(theta_h / 2);
    const double tangent2 = std::pow(std::tan(pi / 2 * i / 90.0), 2);
    for (int step = -100; step <= 100; ++step) {
      const double c = std::bit_cast<double>(std::bit_cast<std::int64_t>(chord2) + step);
      ASSERT_EQ(lookup.row(c), row_of_theta_h(grid, theta_of_half_chord2(c)));
      const double t = std::bit_cast<double>(std::bit_cast<std::int64_t>(tangent2) + step);
      ASSERT_EQ(lookup.column(t), column_of_theta_d(grid, theta_of_difference_tangent2(t)));
    }
  }
}

}  // namespace
}  // namespace lightrig
