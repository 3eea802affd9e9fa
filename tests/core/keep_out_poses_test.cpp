// Ten thousand poses of each kind of gantry against sampling: no accepted way enters a volume, and
// nothing that shows, hides or dazzles is called clear.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/keep_out.h"

namespace lightrig {
namespace {

struct Random {
  std::mt19937 engine{11};
  double between(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(engine);
  }
  Eigen::Vector3d in_box(double half) {
    return {between(-half, half), between(-half, half), between(-half, half)};
  }
};

struct Rig {
  const char* name;
  GantryModel gantry;
  GantryBody body;
};

std::vector<Rig> rigs() {
  GantryModel dome, linear, fixed, table;
  dome.kinematics = DomeKinematics{{0, 0, 0.1}, 0.8};
  dome.axes = {{"azimuth", true, -3, 3, 1, 1, 0}, {"elevation", true, -0.3, 1.5, 1, 1, 0}};
  linear.kinematics = CartesianKinematics{{-1, -1, 0}, -Eigen::Vector3d::UnitZ(), true, {0, 0, 0}};
  linear.axes = {{"x", false, 0, 2, 1, 1, 0},
                 {"y", false, 0, 2, 1, 1, 0},
                 {"z", false, 0, 1, 1, 1, 0},
                 {"pan", true, -3, 3, 1, 1, 0},
                 {"tilt", true, -1.5, 1.5, 1, 1, 0}};
  // The same without a head: the lamp points one way wherever it stands.
  fixed.kinematics = CartesianKinematics{{-1, -1, 0}, Eigen::Vector3d(1, 0, -1).normalized()};
  fixed.axes = {linear.axes[0], linear.axes[1], linear.axes[2]};
  TurntableKinematics arm;
  arm.radius = 0.8;
  arm.azimuth = 0.7;
  arm.arm = true;
  table.kinematics = arm;
  table.axes = {{"turn", true, 0, 6, 1, 1, 0}, {"elevation", true, 0, 3, 1, 1, 0}};
  return {{"dome", dome, {0.05, 0.2, 0.03, Eigen::Vector3d(1, 0, -0.4)}},
          {"linear", linear, {0.06, 0.5, 0.03, {}, Eigen::Vector3d(0.6, 0, 0.8)}},
          {"linear, fixed", fixed, {0.06, 0.4, 0.03, {}, Eigen::Vector3d(0, 0.6, 0.8)}},
          {"table", table, {0.05, 0.3, 0.02, Eigen::Vector3d(1.1, 0, -0.2)}}};
}

GantryPosition anywhere(const GantryModel& gantry, Random& random) {
  GantryPosition p;
  p.axes.resize(static_cast<Eigen::Index>(gantry.axes.size()));
  for (std::size_t i = 0; i < gantry.axes.size(); ++i)
    p.axes[static_cast<Eigen::Index>(i)] = random.between(gantry.axes[i].min, gantry.axes[i].max);
  return p;
}

/// Points of the solid, by the words of the documentation rather than by body_at().
std::vector<std::pair<Eigen::Vector3d, double>> sampled_body(const Rig& rig,
                                                             const GantryPosition& at) {
  std::vector<std::pair<Eigen::Vector3d, double>> points;
  const auto along = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius) {
    for (int k = 0; k <= 30; ++k) points.emplace_back(a + (b - a) * (k / 30.0), radius);
  };
  const auto on_arm = [&](const Eigen::Vector3d& centre, double azimuth, double elevation) {
    const Eigen::Vector3d out(std::cos(elevation) * std::cos(azimuth),
                              std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    const Eigen::Vector3d elbow = centre + (0.8 + rig.body.boom_length) * out;
    points.emplace_back(centre + 0.8 * out, rig.body.lamp_radius);
    along(centre + 0.8 * out, elbow, rig.body.boom_radius);
    const Eigen::Vector3d& foot = *rig.body.mast_foot;
    along(elbow,
          centre + Eigen::Vector3d(std::cos(azimuth) * foot.x() - std::sin(azimuth) * foot.y(),
                                   std::sin(azimuth) * foot.x() + std::cos(azimuth) * foot.y(),
                                   foot.z()),
          rig.body.boom_radius);
  };
  if (rig.name[0] == 'd') on_arm({0, 0, 0.1}, at.axes[0], at.axes[1]);
  if (rig.name[0] == 't') on_arm({0, 0, 0}, 0.7, at.axes[1]);
  if (rig.name[0] == 'l') {
    const Eigen::Vector3d lamp = Eigen::Vector3d(-1, -1, 0) + at.axes.head<3>();
    points.emplace_back(lamp, rig.body.lamp_radius);
    along(lamp, lamp + rig.body.boom_length * rig.body.boom_direction, rig.body.boom_radius);
  }
  return points;
}

double outside_by(const Eigen::Vector3d& p, const Solid& volume) {
  if (const auto* ball = std::get_if<Ball>(&volume))
    return std::max(0.0, (p - ball->centre).norm() - ball->radius);
  const auto& box = std::get<Box>(volume);
  return (p - p.cwiseMax(box.min).cwiseMin(box.max)).norm();
}

std::vector<Solid> volumes(Random& random) {
  std::vector<Solid> all{Box{{-0.1, -0.1, -0.1}, {0.1, 0.1, 0.15}},
                         Box{{-9, -9, -9}, {9, 9, -0.5}}};
  for (int i = 0; i < 3; ++i) {
    all.push_back(Ball{random.in_box(1.2), random.between(0.05, 0.2)});
    const Eigen::Vector3d c = random.in_box(1.2);
    all.push_back(Box{c - Eigen::Vector3d::Constant(0.1), c + Eigen::Vector3d::Constant(0.1)});
  }
  return all;
}

TEST(KeepOutPoses, NoAcceptedWayEntersAVolumeOverTenThousandPosesOfEachKindOfGantry) {
  Random random;
  constexpr double margin = 0.01;
  for (const Rig& rig : rigs()) {
    int accepted = 0, refused = 0, wrongly_refused = 0, poses = 0;
    while (poses < 10000 || refused < 60) {
      const std::vector<Solid> obstacles = volumes(random);
      const GantryPosition from = anywhere(rig.gantry, random), to = anywhere(rig.gantry, random);
      const auto contact = first_contact(rig.gantry, rig.body, from, to, obstacles, margin);
      double least = 1e9;
      constexpr int steps = 60;
      for (int i = 0; i <= steps; ++i) {
        GantryPosition here;
        here.axes = from.axes + (to.axes - from.axes) * (i / double{steps});
        for (const auto& [p, radius] : sampled_body(rig, here))
          for (const Solid& volume : obstacles)
            least = std::min(least, outside_by(p, volume) - radius);
        poses += !contact;
      }
      if (contact) {
        ++refused;
        wrongly_refused += least > margin + 0.03;
      } else {
        ++accepted;
        ASSERT_GE(least, margin - 1e-9) << rig.name;
      }
      ASSERT_LT(accepted + refused, 6000) << rig.name << ": " << accepted << " accepted";
    }
    EXPECT_LT(wrongly_refused, refused / 10 + 1) << rig.name;
    EXPECT_GE(accepted, 160) << rig.name;
  }
}

TEST(KeepOutPoses, ABodyCalledClearHidesNoPointOfTheObject) {
  Random random;
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 900;
  camera.cx = 320;
  camera.cy = 240;
  const Box object{{-0.1, -0.08, -0.05}, {0.12, 0.1, 0.15}};
  for (const auto kind :
       {CameraModel::Projection::perspective, CameraModel::Projection::orthographic}) {
    camera.projection = kind;
    camera.camera_from_world = look_at({0.3, -1.1, 0.6}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d eye(0.3, -1.1, 0.6);
    int hidden = 0, clear_said_hidden = 0, clear = 0;
    for (int trial = 0; trial < 3000; ++trial) {
      const Eigen::Vector3d a = random.in_box(0.8);
      const Capsule body{a, a + random.in_box(0.3), random.between(0.01, 0.1)};
      bool hides_some = false;
      for (int ray = 0; ray < 40 && !hides_some; ++ray) {
        const Eigen::Vector3d p(random.between(-0.1, 0.12), random.between(-0.08, 0.1),
                                random.between(-0.05, 0.15));
        const Eigen::Vector3d back = view_direction(camera, p);
        const double length = kind == CameraModel::Projection::perspective ? (eye - p).norm() : 3;
        for (int k = 0; k <= 200 && !hides_some; ++k) {
          const Eigen::Vector3d q = p + back * (length * k / 200);
          const Eigen::Vector3d axis = body.b - body.a;
          const double t = std::clamp((q - body.a).dot(axis) / axis.squaredNorm(), 0.0, 1.0);
          hides_some = (q - body.a - t * axis).norm() < body.radius;
        }
      }
      const bool said = hides(camera, body, object);
      if (hides_some) {
        EXPECT_TRUE(said);
        ++hidden;
      } else {
        ++clear;
        clear_said_hidden += said;
      }
    }
    EXPECT_GT(hidden, 30);
    EXPECT_LT(clear_said_hidden, clear / 10);
  }
}

TEST(KeepOutPoses, ALampBehindTheObjectShinesIntoTheLensAndOneBesideTheCameraDoesNot) {
  CameraModel camera;
  camera.camera_from_world = look_at({0, -1, 0}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  const double cone = 0.2;
  const auto near = [](const Eigen::Vector3d& p) {
    LightPosition light;
    light.p = p;
    return light;
  };
  EXPECT_TRUE(shines_into_lens(camera, near({0, 1, 0}), cone));
  EXPECT_TRUE(shines_into_lens(camera, near({0.19 * 2, 1, 0}), cone));   // 10.8° off, of 11.5°
  EXPECT_FALSE(shines_into_lens(camera, near({0.21 * 2, 1, 0}), cone));  // 11.9°
  EXPECT_FALSE(shines_into_lens(camera, near({0, -1.5, 0}), cone));      // behind the camera
  LightPosition turned_away = near({0, 1, 0});
  turned_away.aim = {0, 1, 0};
  turned_away.lobe.exponent = 1;
  EXPECT_FALSE(shines_into_lens(camera, turned_away, cone));
  LightPosition distant = near({0, 1, 0});
  distant.distant = true;
  EXPECT_TRUE(shines_into_lens(camera, distant, cone));
}

}  // namespace
}  // namespace lightrig
