// Where each kind of gantry puts its lamp and how the object then lies, and the way back.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"
#include "core/gantry_model.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

/// Rounding in a target that lies exactly on a limit must not put it out of travel.
constexpr double limit_slack = 1e-9;  // [rad] or [m]

Eigen::Vector3d direction_of(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

/// A lamp at `p` that points along `aim`.
LightPosition near_lamp(const GantryModel& gantry, const Eigen::Vector3d& p,
                        const Eigen::Vector3d& aim) {
  LightPosition light;
  light.p = p;
  if (gantry.lobe.uniform()) return light;
  light.aim = aim;
  light.lobe = gantry.lobe;
  return light;
}

/// A lamp in this direction from a centre that it is aimed at.
LightPosition lamp_about(const GantryModel& gantry, const Eigen::Vector3d& centre, double radius,
                         const Eigen::Vector3d& direction) {
  if (gantry.distant_lamp) return {.distant = true, .p = direction};
  return near_lamp(gantry, centre + radius * direction, -direction);
}

// --- where the lamp is

LightPosition light_of(const DomeKinematics& dome, const GantryModel& gantry,
                       const AxisValues& axes) {
  CHECK(axes.size() == 2);
  return lamp_about(gantry, dome.centre, dome.radius, direction_of(axes[0], axes[1]));
}

LightPosition light_of(const CartesianKinematics& cartesian, const GantryModel& gantry,
                       const AxisValues& axes) {
  CHECK(axes.size() == (cartesian.head ? 5 : 3) && !gantry.distant_lamp);
  const Eigen::Vector3d aim = cartesian.head ? direction_of(axes[3], axes[4]) : cartesian.aim;
  return near_lamp(gantry, cartesian.origin + axes.head<3>(), aim);
}

LightPosition light_of(const TurntableKinematics& table, const GantryModel& gantry,
                       const AxisValues& axes) {
  CHECK(axes.size() == (table.arm ? 2 : 1));
  const double elevation = table.arm ? axes[1] : table.elevation;
  return lamp_about(gantry, table.centre, table.radius,
                    direction_of(table.azimuth - axes[0], elevation));
}

LightPosition light_of(const FixedLampsKinematics& fixed, const GantryModel& gantry,
                       const AxisValues& axes) {
  CHECK(axes.size() == 1);
  const auto index = static_cast<std::size_t>(std::lround(axes[0]));
  CHECK(index < fixed.lamps.size());
  const Eigen::Vector3d outwards = fixed.lamps[index] - fixed.centre;
  return lamp_about(gantry, fixed.centre, outwards.norm(), outwards.normalized());
}

// --- the way back

/// The value angle + 2πk nearest to the axis' home that its travel holds.
std::optional<double> wrapped_into_travel(const Axis& axis, double angle) {
  const double lowest = angle + 2 * pi * std::ceil((axis.min - limit_slack - angle) / (2 * pi));
  std::optional<double> best;
  for (double value = lowest; value <= axis.max + limit_slack; value += 2 * pi) {
    const double held = std::clamp(value, axis.min, axis.max);
    if (!best || std::abs(held - axis.home) < std::abs(*best - axis.home)) best = held;
  }
  return best;
}

std::optional<double> held_in_travel(const Axis& axis, double value) {
  if (!(value >= axis.min - limit_slack && value <= axis.max + limit_slack)) return std::nullopt;
  return std::clamp(value, axis.min, axis.max);
}

/// Azimuth and elevation of a direction that two rotary axes may take in two ways, the second with
/// the arc swung over the zenith; of those in travel the one nearest to home.
std::optional<GantryPosition> aimed(const Axis& azimuth_axis, const Axis& elevation_axis,
                                    const Eigen::Vector3d& direction) {
  const double horizontal = std::hypot(direction.x(), direction.y());
  const double elevation = std::atan2(direction.z(), horizontal);
  // At the poles every azimuth is right: the one that needs least motion from home.
  const bool at_pole = horizontal < 1e-12 * direction.norm();
  const double azimuth = at_pole ? std::clamp(azimuth_axis.home, azimuth_axis.min, azimuth_axis.max)
                                 : std::atan2(direction.y(), direction.x());
  std::optional<GantryPosition> best;
  double best_distance = 0;
  const auto consider = [&](double a, double e) {
    const std::optional<double> held_a = wrapped_into_travel(azimuth_axis, a);
    const std::optional<double> held_e = wrapped_into_travel(elevation_axis, e);
    if (!held_a || !held_e) return;
    const double distance =
        std::abs(*held_a - azimuth_axis.home) + std::abs(*held_e - elevation_axis.home);
    if (best && distance >= best_distance) return;
    GantryPosition position;
    position.axes = Eigen::Vector2d(*held_a, *held_e);
    best = position;
    best_distance = distance;
  };
  consider(azimuth, elevation);
  consider(at_pole ? azimuth : azimuth + pi, pi - elevation);
  return best;
}

/// From the centre to p, where that is a place on a sphere about it; empty off the sphere.
std::optional<Eigen::Vector3d> arm_to(const GantryModel& gantry, const Eigen::Vector3d& centre,
                                      double radius, const Eigen::Vector3d& p) {
  const Eigen::Vector3d arm = gantry.distant_lamp ? p : Eigen::Vector3d(p - centre);
  const double length = arm.norm();
  if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
  const double off = std::max(gantry.tolerance, 1e-6) * radius;
  if (!gantry.distant_lamp && std::abs(length - radius) > off) return std::nullopt;
  return arm;
}

std::optional<GantryPosition> reach_of(const DomeKinematics& dome, const GantryModel& gantry,
                                       const Eigen::Vector3d& p) {
  CHECK(gantry.axes.size() == 2);
  const auto arm = arm_to(gantry, dome.centre, dome.radius, p);
  if (!arm) return std::nullopt;
  return aimed(gantry.axes[0], gantry.axes[1], *arm);
}

std::optional<GantryPosition> reach_of(const CartesianKinematics& cartesian,
                                       const GantryModel& gantry, const Eigen::Vector3d& p) {
  CHECK(gantry.axes.size() == (cartesian.head ? 5U : 3U));
  const Eigen::Vector3d travel = p - cartesian.origin;
  GantryPosition position;
  position.axes.resize(static_cast<Eigen::Index>(gantry.axes.size()));
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto held = held_in_travel(gantry.axes[static_cast<std::size_t>(i)], travel[i]);
    if (!held) return std::nullopt;
    position.axes[i] = *held;
  }
  if (!cartesian.head) return position;
  const Eigen::Vector3d sight = cartesian.target - p;
  if (!(sight.norm() > 0)) return std::nullopt;
  const auto head = aimed(gantry.axes[3], gantry.axes[4], sight);
  if (!head) return std::nullopt;
  position.axes.tail<2>() = head->axes;
  return position;
}

std::optional<GantryPosition> reach_of(const TurntableKinematics& table, const GantryModel& gantry,
                                       const Eigen::Vector3d& p) {
  const auto arm = arm_to(gantry, table.centre, table.radius, p);
  if (!arm) return std::nullopt;
  const double elevation = std::atan2(arm->z(), std::hypot(arm->x(), arm->y()));
  const auto turn =
      wrapped_into_travel(gantry.axes[0], table.azimuth - std::atan2(arm->y(), arm->x()));
  if (!turn) return std::nullopt;
  GantryPosition position;
  if (!table.arm) {
    if (std::abs(elevation - table.elevation) > std::max(gantry.tolerance, 1e-6))
      return std::nullopt;
    position.axes = Eigen::Matrix<double, 1, 1>(*turn);
    return position;
  }
  const auto held = held_in_travel(gantry.axes[1], elevation);
  if (!held) return std::nullopt;
  position.axes = Eigen::Vector2d(*turn, *held);
  return position;
}

std::optional<GantryPosition> reach_of(const FixedLampsKinematics& fixed, const GantryModel& gantry,
                                       const Eigen::Vector3d& p) {
  const double near = gantry.distant_lamp ? 1e-9 : 1e-6;  // [rad] or [m]
  for (std::size_t i = 0; i < fixed.lamps.size(); ++i) {
    const Eigen::Vector3d there =
        gantry.distant_lamp ? (fixed.lamps[i] - fixed.centre).normalized() : fixed.lamps[i];
    const Eigen::Vector3d wanted = gantry.distant_lamp ? p.normalized() : p;
    if (!((there - wanted).norm() <= near)) continue;
    GantryPosition position;
    position.axes = Eigen::Matrix<double, 1, 1>(static_cast<double>(i));
    return position;
  }
  return std::nullopt;
}

}  // namespace

LightPosition light_at(const GantryModel& gantry, const GantryPosition& position) {
  return std::visit(
      [&](const auto& kinematics) { return light_of(kinematics, gantry, position.axes); },
      gantry.kinematics);
}

std::optional<GantryPosition> reach(const GantryModel& gantry, const Eigen::Vector3d& p) {
  return std::visit([&](const auto& kinematics) { return reach_of(kinematics, gantry, p); },
                    gantry.kinematics);
}

bool turns_object(const GantryModel& gantry) {
  return std::holds_alternative<TurntableKinematics>(gantry.kinematics);
}

Eigen::Isometry3d object_turn(const GantryModel& gantry, const GantryPosition& position) {
  Eigen::Isometry3d turn = Eigen::Isometry3d::Identity();
  if (const auto* table = std::get_if<TurntableKinematics>(&gantry.kinematics)) {
    turn.translate(table->centre);
    turn.rotate(Eigen::AngleAxisd(position.axes[0], Eigen::Vector3d::UnitZ()));
    turn.translate(-table->centre);
  }
  return turn;
}

CameraModel camera_at(const GantryModel& gantry, const CameraModel& camera,
                      const GantryPosition& position) {
  CameraModel seen = camera;
  if (turns_object(gantry))
    seen.camera_from_world = camera.camera_from_world * object_turn(gantry, position);
  return seen;
}

}  // namespace lightrig
