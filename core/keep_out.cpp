#include "core/keep_out.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/check.h"

namespace lightrig {
namespace {

/// Ways closer than this to the margin count as contact, so that the advancement ends [m].
constexpr double touch = 1e-4;

double distance_to_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                           const Eigen::Vector3d& b) {
  const Eigen::Vector3d along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0.0;
  return (a + t * along - p).norm();
}

double distance_to_box(const Eigen::Vector3d& p, const Box& box) {
  return (box.min - p).cwiseMax(p - box.max).cwiseMax(0.0).norm();
}

/// The squared distance of a point on the segment to the box is convex and piecewise quadratic in
/// its parameter, with joints where a coordinate passes a face: the least of the pieces' minima.
double distance_to_box(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Box& box) {
  const Eigen::Vector3d along = b - a;
  std::vector<double> joints{0.0, 1.0};
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (along[i] == 0) continue;
    for (const double face : {box.min[i], box.max[i]}) {
      const double t = (face - a[i]) / along[i];
      if (t > 0 && t < 1) joints.push_back(t);
    }
  }
  std::sort(joints.begin(), joints.end());
  double least = std::min(distance_to_box(a, box), distance_to_box(b, box));
  for (std::size_t piece = 0; piece + 1 < joints.size(); ++piece) {
    // Within a piece each outside coordinate is at offset + slope · t from its face.
    const Eigen::Vector3d middle = a + along * ((joints[piece] + joints[piece + 1]) / 2);
    double offset_slope = 0, slope_slope = 0;
    for (Eigen::Index i = 0; i < 3; ++i) {
      if (middle[i] >= box.min[i] && middle[i] <= box.max[i]) continue;
      const double face = middle[i] < box.min[i] ? box.min[i] : box.max[i];
      offset_slope += (a[i] - face) * along[i];
      slope_slope += along[i] * along[i];
    }
    if (slope_slope == 0) {
      least = std::min(least, distance_to_box(middle, box));
      continue;
    }
    const double t = std::clamp(-offset_slope / slope_slope, joints[piece], joints[piece + 1]);
    least = std::min(least, distance_to_box(a + t * along, box));
  }
  return least;
}

double distance(const Capsule& body, const Ball& ball) {
  return distance_to_segment(ball.centre, body.a, body.b) - ball.radius - body.radius;
}
double distance(const Capsule& body, const Box& box) {
  return distance_to_box(body.a, body.b, box) - body.radius;
}

/// Lamp, boom and mast of an arm that turns about a centre.
std::vector<Capsule> arm_about(const Eigen::Vector3d& centre, double radius, double a, double e,
                               const GantryBody& body) {
  const Eigen::Vector3d outwards(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e));
  const Eigen::Vector3d lamp = centre + radius * outwards;
  const Eigen::Vector3d elbow = lamp + body.boom_length * outwards;
  std::vector<Capsule> parts{{lamp, lamp, body.lamp_radius}};
  if (body.boom_length > 0) parts.push_back({lamp, elbow, body.boom_radius});
  if (body.mast_foot) {
    const Eigen::AngleAxisd turn(a, Eigen::Vector3d::UnitZ());
    parts.push_back({elbow, centre + turn * *body.mast_foot, body.boom_radius});
  }
  return parts;
}

std::vector<Capsule> body_of(const DomeKinematics& dome, const GantryBody& body,
                             const AxisValues& axes) {
  CHECK(axes.size() == 2);
  return arm_about(dome.centre, dome.radius, axes[0], axes[1], body);
}
std::vector<Capsule> body_of(const CartesianKinematics& cartesian, const GantryBody& body,
                             const AxisValues& axes) {
  const Eigen::Vector3d lamp = cartesian.origin + axes.head<3>();
  std::vector<Capsule> parts{{lamp, lamp, body.lamp_radius}};
  if (body.boom_length > 0)
    parts.push_back({lamp, lamp + body.boom_length * body.boom_direction, body.boom_radius});
  return parts;
}
std::vector<Capsule> body_of(const TurntableKinematics& table, const GantryBody& body,
                             const AxisValues& axes) {
  const double elevation = table.arm ? axes[1] : table.elevation;
  return arm_about(table.centre, table.radius, table.azimuth, elevation, body);
}
std::vector<Capsule> body_of(const FixedLampsKinematics& fixed, const GantryBody& body,
                             const AxisValues& axes) {
  const Eigen::Vector3d& lamp = fixed.lamps[static_cast<std::size_t>(std::lround(axes[0]))];
  return {{lamp, lamp, body.lamp_radius}};
}

// No point of the body moves further than this [m] on the straight way between the positions.

/// The axes turn about the centre, and no point is further from it than the body reaches.
double arm_reach(double radius, const GantryBody& body) {
  return std::max(radius + body.boom_length, body.mast_foot ? body.mast_foot->norm() : 0.0);
}
double longest_way(const DomeKinematics& dome, const GantryBody& body, const AxisValues& from,
                   const AxisValues& to) {
  return arm_reach(dome.radius, body) * (to - from).cwiseAbs().sum();
}
/// A carriage that is only shifted; a head turns the lamp on the spot, within its ball.
double longest_way(const CartesianKinematics&, const GantryBody&, const AxisValues& from,
                   const AxisValues& to) {
  return (to - from).head<3>().norm();
}
double longest_way(const TurntableKinematics& table, const GantryBody& body, const AxisValues& from,
                   const AxisValues& to) {
  return table.arm ? arm_reach(table.radius, body) * std::abs(to[1] - from[1]) : 0.0;
}
double longest_way(const FixedLampsKinematics&, const GantryBody&, const AxisValues&,
                   const AxisValues&) {
  return 0;
}

}  // namespace

std::vector<Capsule> body_at(const GantryModel& gantry, const GantryBody& body,
                             const GantryPosition& position) {
  return std::visit(
      [&](const auto& kinematics) { return body_of(kinematics, body, position.axes); },
      gantry.kinematics);
}

double clearance(const Capsule& body, const Solid& volume) {
  return std::visit([&](const auto& shape) { return distance(body, shape); }, volume);
}

Clearance clearance(const GantryModel& gantry, const GantryBody& body,
                    const GantryPosition& position, std::span<const Solid> volumes) {
  Clearance least{std::numeric_limits<double>::infinity(), 0};
  for (const Capsule& part : body_at(gantry, body, position)) {
    for (std::size_t i = 0; i < volumes.size(); ++i) {
      const double d = clearance(part, volumes[i]);
      if (d < least.distance) least = {d, i};
    }
  }
  return least;
}

std::optional<Contact> first_contact(const GantryModel& gantry, const GantryBody& body,
                                     const GantryPosition& from, const GantryPosition& to,
                                     std::span<const Solid> volumes, double margin) {
  // Fixed lamps stand where they stand: nothing moves that could meet anything.
  if (volumes.empty() || std::holds_alternative<FixedLampsKinematics>(gantry.kinematics))
    return std::nullopt;
  const double way = std::visit(
      [&](const auto& k) { return longest_way(k, body, from.axes, to.axes); }, gantry.kinematics);
  double fraction = 0;
  while (true) {
    GantryPosition here;
    here.axes = from.axes + fraction * (to.axes - from.axes);
    const Clearance least = clearance(gantry, body, here, volumes);
    const double free = least.distance - margin;
    if (!(free > touch)) return Contact{least.volume, here};
    if (fraction >= 1) return std::nullopt;
    // The last pose is looked at too, and what lies between is at least as free as the step allows.
    fraction = way > free ? std::min(1.0, fraction + free / way) : 1.0;
  }
}

namespace {

/// Outside, if it lies wholly beyond one side of the pyramid (or prism) of sight over `outline`, in
/// image coordinates without distortion: at depth 1 (perspective) or anywhere (parallel).
bool beside(const CameraModel& camera, const Eigen::AlignedBox2d& outline, const Capsule& body) {
  const Eigen::Vector3d a = camera.camera_from_world * body.a;
  const Eigen::Vector3d b = camera.camera_from_world * body.b;
  const auto beyond = [&](const Eigen::Vector3d& inwards, double offset) {
    const double limit = -body.radius * inwards.norm();
    return inwards.dot(a) + offset < limit && inwards.dot(b) + offset < limit;
  };
  const auto sides = [&](Eigen::Index axis) {
    const Eigen::Vector3d across = Eigen::Vector3d::Unit(axis), depth = Eigen::Vector3d::UnitZ();
    const double low = outline.min()[axis], high = outline.max()[axis];
    if (distant(camera)) return beyond(across, -low) || beyond(-across, high);
    return beyond(across - low * depth, 0) || beyond(high * depth - across, 0);
  };
  if (!distant(camera) && beyond(Eigen::Vector3d::UnitZ(), 0)) return true;
  return sides(0) || sides(1);
}

}  // namespace

bool in_view(const CameraModel& camera, const Capsule& body) {
  Eigen::AlignedBox2d outline;
  constexpr int pieces = 32;
  for (int i = 0; i <= pieces; ++i) {
    const double u = -0.5 + camera.width * static_cast<double>(i) / pieces;
    const double v = -0.5 + camera.height * static_cast<double>(i) / pieces;
    for (const Eigen::Vector2d& edge :
         {Eigen::Vector2d(u, -0.5), Eigen::Vector2d(u, camera.height - 0.5),
          Eigen::Vector2d(-0.5, v), Eigen::Vector2d(camera.width - 0.5, v)}) {
      const Ray ray = ray_through(camera, edge.x(), edge.y());
      const Eigen::Vector3d p = camera.camera_from_world * (ray.origin + ray.direction);
      outline.extend(distant(camera) ? Eigen::Vector2d(p.head<2>())
                                     : Eigen::Vector2d(p.head<2>() / p.z()));
    }
  }
  return !beside(camera, outline, body);
}

bool hides(const CameraModel& camera, const Capsule& body, const Box& box) {
  Eigen::AlignedBox2d outline;
  double furthest = -std::numeric_limits<double>::infinity();
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d p((corner & 1) != 0 ? box.max.x() : box.min.x(),
                            (corner & 2) != 0 ? box.max.y() : box.min.y(),
                            (corner & 4) != 0 ? box.max.z() : box.min.z());
    const Eigen::Vector3d seen = camera.camera_from_world * p;
    furthest = std::max(furthest, seen.z());
    // A camera within or beside the box is no rig: everything is then in the way.
    if (!distant(camera) && !(seen.z() > 0)) return true;
    outline.extend(distant(camera) ? Eigen::Vector2d(seen.head<2>())
                                   : Eigen::Vector2d(seen.head<2>() / seen.z()));
  }
  const double nearest =
      std::min((camera.camera_from_world * body.a).z(), (camera.camera_from_world * body.b).z()) -
      body.radius;
  return nearest <= furthest && !beside(camera, outline, body);
}

bool shines_into_lens(const CameraModel& camera, const LightPosition& light, double cone) {
  const Eigen::Matrix3d world_from_camera = camera.camera_from_world.linear().transpose();
  const Eigen::Vector3d sight = world_from_camera.col(2);
  if (light.distant) return light.p.dot(sight) > std::cos(cone);
  const Eigen::Vector3d eye = -(world_from_camera * camera.camera_from_world.translation());
  const Eigen::Vector3d to_lamp = light.p - eye;
  // A parallel view has no eye: the lamp lights the lens wherever it shines along the sight.
  if (distant(camera)) return light.lobe.uniform() ? false : light.aim.dot(sight) < -std::cos(cone);
  return to_lamp.dot(sight) > std::cos(cone) * to_lamp.norm() && light.reaches(eye);
}

}  // namespace lightrig
