#include "core/keep_out.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lightrig {
namespace {

GantryModel dome() {
  GantryModel gantry;
  gantry.kinematics = DomeKinematics{{0.1, 0, 0.2}, 1.0};
  gantry.axes = {{"azimuth", true, -3.1, 3.1, 1, 1, 0}, {"elevation", true, -0.5, 1.5, 1, 1, 0}};
  return gantry;
}

const GantryBody whole_body{0.05, 0.3, 0.02, Eigen::Vector3d(1.3, 0, -0.6)};

GantryPosition at(double a, double e) {
  GantryPosition position;
  position.axes = Eigen::Vector2d(a, e);
  return position;
}

struct Random {
  explicit Random(unsigned seed) : engine(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  }
  Eigen::Vector3d in_cube(double half) {
    return {between(-half, half), between(-half, half), between(-half, half)};
  }
  std::mt19937 engine;
};

Solid random_volume(Random& random) {
  const Eigen::Vector3d centre = random.in_cube(1.5);
  if (random.between(0, 1) < 0.5) return Ball{centre, random.between(0.02, 0.4)};
  const Eigen::Vector3d half(random.between(0.01, 0.4), random.between(0.01, 0.4),
                             random.between(0.01, 0.4));
  return Box{centre - half, centre + half};
}

/// Signed distance of a point to a volume's surface from outside; 0 inside. Written apart.
double outside_by(const Eigen::Vector3d& p, const Solid& volume) {
  if (const auto* sphere = std::get_if<Ball>(&volume)) {
    return std::max(0.0, (p - sphere->centre).norm() - sphere->radius);
  }
  const auto& box = std::get<Box>(volume);
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    if (p[i] < box.min[i]) sum += (box.min[i] - p[i]) * (box.min[i] - p[i]);
    if (p[i] > box.max[i]) sum += (p[i] - box.max[i]) * (p[i] - box.max[i]);
  }
  return std::sqrt(sum);
}

TEST(KeepOut, ClearanceAgreesWithSamplingTheSegment) {
  Random random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    Capsule body{random.in_cube(1.5), random.in_cube(1.5), random.between(0, 0.2)};
    if (trial % 5 == 0) body.b = body.a;
    if (trial % 7 == 0) body.b.x() = body.a.x();  // parallel to two faces of every box
    const Solid volume = random_volume(random);
    double sampled = 1e300;
    constexpr int steps = 3000;
    for (int i = 0; i <= steps; ++i) {
      const Eigen::Vector3d p = body.a + (body.b - body.a) * (static_cast<double>(i) / steps);
      sampled = std::min(sampled, outside_by(p, volume) - body.radius);
    }
    const double exact = clearance(body, volume);
    if (sampled > -body.radius) {
      EXPECT_LE(exact, sampled + 1e-12);
      EXPECT_GE(exact, sampled - (body.b - body.a).norm() / steps);
    } else {
      EXPECT_LT(exact, 1e-12);
    }
  }
}

TEST(KeepOut, NoAcceptedWayEntersAVolumeAtAnyOfTenThousandPoses) {
  const GantryModel gantry = dome();
  Random random(2);
  int accepted = 0, refused = 0, poses = 0;
  while (poses < 150000) {
    const std::vector<Solid> volumes{random_volume(random), random_volume(random)};
    const GantryPosition from = at(random.between(-3.1, 3.1), random.between(-0.5, 1.5));
    const GantryPosition to = at(random.between(-3.1, 3.1), random.between(-0.5, 1.5));
    const auto contact = first_contact(gantry, whole_body, from, to, volumes, 0.01);
    if (contact) {
      ++refused;
      EXPECT_LT(clearance(gantry, whole_body, contact->position, volumes).distance,
                0.01 + 1.001e-4);
      continue;
    }
    ++accepted;
    const double total = move_time(gantry, from, to);
    for (int i = 0; i <= 200; ++i, ++poses) {
      const GantryPosition here = move_position(gantry, from, to, total * i / 200);
      const Eigen::Vector3d lamp = light_at(gantry, here).p, centre(0.1, 0, 0.2);
      const Eigen::Vector3d elbow = centre + 1.3 * (lamp - centre);
      const double a = here.axes[0];
      const Eigen::Vector3d foot =
          centre + Eigen::Vector3d(1.3 * std::cos(a), 1.3 * std::sin(a), -0.6);
      for (const Solid& volume : volumes) {
        ASSERT_GE(outside_by(lamp, volume), 0.05 + 0.01);
        for (int k = 0; k <= 20; ++k) {
          ASSERT_GE(outside_by(lamp + (elbow - lamp) * (k / 20.0), volume), 0.02 + 0.01);
          ASSERT_GE(outside_by(elbow + (foot - elbow) * (k / 20.0), volume), 0.02 + 0.01);
        }
      }
    }
  }
  EXPECT_GT(accepted, 100);
  EXPECT_GT(refused, 100);
}

TEST(KeepOut, AThinObstacleOnALongWayIsNotSteppedOver) {
  // A wire of 1 mm across the lamp's circle, however long the way: sampling every 5 mm misses it.
  const GantryModel gantry = dome();
  const double a = 1.234;
  const Eigen::Vector3d on_circle(0.1 + std::cos(a), std::sin(a), 0.2);
  const std::vector<Solid> wire{Ball{on_circle, 0.0005}};
  const auto contact = first_contact(gantry, GantryBody{}, at(-3, 0), at(3, 0), wire, 0);
  ASSERT_TRUE(contact);
  EXPECT_NEAR(contact->position.axes[0], a, 0.001);
  EXPECT_TRUE(first_contact(gantry, GantryBody{}, at(3, 0), at(-3, 0), wire, 0));
  EXPECT_FALSE(first_contact(gantry, GantryBody{}, at(-3, 0), at(1.2, 0), wire, 0));
}

TEST(KeepOut, ANearMissIsAcceptedAndATouchIsNot) {
  // The lamp's ball (5 cm) on a circle of 1 m passes a ball of 10 cm that stands outside it.
  const GantryModel gantry = dome();
  const GantryBody ball_alone{0.05, 0, 0, {}};
  const auto passing = [&](double gap) {
    const Ball ball{{0.1 + 1.0 + 0.15 + gap, 0, 0.2}, 0.1};
    const std::vector<Solid> volumes{ball};
    return first_contact(gantry, ball_alone, at(-1, 0), at(1, 0), volumes, 0);
  };
  EXPECT_FALSE(passing(0.0005));
  EXPECT_TRUE(passing(-0.0005));
}

TEST(KeepOut, TheBoomAndTheMastCountAndADistantLampsBodyToo) {
  GantryModel gantry = dome();
  const std::vector<Solid> beside_boom{Ball{{0.1 + 1.2, 0, 0.2}, 0.05}};
  EXPECT_LT(clearance(gantry, whole_body, at(0, 0), beside_boom).distance, 0);
  const std::vector<Solid> at_mast{Ball{{0.1 + 1.3, 0, -0.1}, 0.05}};
  EXPECT_LT(clearance(gantry, whole_body, at(0, 0), at_mast).distance, 0);
  EXPECT_GT(clearance(gantry, whole_body, at(1.5, 0), at_mast).distance, 0.5);
  gantry.distant_lamp = true;
  EXPECT_LT(clearance(gantry, whole_body, at(0, 0), beside_boom).distance, 0);
  EXPECT_TRUE(std::isinf(clearance(gantry, whole_body, at(0, 0), {}).distance));
}

TEST(InView, IsNeverFalseForABodyOfWhichAPointShows) {
  Random random(3);
  for (const auto projection :
       {CameraModel::Projection::perspective, CameraModel::Projection::orthographic}) {
    CameraModel camera;
    camera.projection = projection;
    camera.width = 640;
    camera.height = 480;
    camera.fx = camera.fy = 700;
    camera.cx = 320;
    camera.cy = 240;
    camera.distortion = {-0.2, 0.08, 0.001, -0.001, 0};
    camera.camera_from_world = look_at({0.5, -1, 0.7}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
    int seen = 0, unseen_said_seen = 0, unseen = 0;
    for (int trial = 0; trial < 4000; ++trial) {
      const Eigen::Vector3d a = random.in_cube(2);
      const Capsule body{a, a + random.in_cube(0.3), random.between(0, 0.1)};
      bool shows = false;
      for (int i = 0; i < 200 && !shows; ++i) {
        const Eigen::Vector3d on_axis = body.a + random.between(0, 1) * (body.b - body.a);
        const Eigen::Vector3d p =
            on_axis + random.in_cube(1).normalized() * (body.radius * random.between(0, 1));
        const Eigen::Vector2d pixel = project(camera, p);
        // Points far outside the field may be folded back into it by the distortion polynomial.
        const Eigen::Vector3d c = camera.camera_from_world * p;
        const bool in_field = distant(camera) || c.head<2>().norm() < 0.9 * c.z();
        shows = in_field && pixel.x() > -0.5 && pixel.x() < 639.5 && pixel.y() > -0.5 &&
                pixel.y() < 479.5;
      }
      const bool said = in_view(camera, body);
      if (shows) {
        EXPECT_TRUE(said);
        ++seen;
      } else {
        ++unseen;
        unseen_said_seen += said;
      }
    }
    EXPECT_GT(seen, 100);
    EXPECT_GT(unseen, 1000);
    EXPECT_LT(unseen_said_seen, unseen / 20);
  }
}

}  // namespace
}  // namespace lightrig
