#include "core/gantry_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

/// Rounding in a target that lies exactly on a limit must not put it out of travel.
constexpr double limit_slack = 1e-9;  // [rad] or [m]

Eigen::Vector3d dome_direction(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

LightPosition light_of(const DomeKinematics& dome, bool distant_lamp, const AxisValues& axes) {
  CHECK(axes.size() == 2);
  const Eigen::Vector3d direction = dome_direction(axes[0], axes[1]);
  if (distant_lamp) return {true, direction};
  return {false, dome.centre + dome.radius * direction};
}

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

std::optional<GantryPosition> reach_of(const DomeKinematics& dome, const GantryModel& gantry,
                                       const Eigen::Vector3d& p) {
  CHECK(gantry.axes.size() == 2);
  const Axis& azimuth_axis = gantry.axes[0];
  const Axis& elevation_axis = gantry.axes[1];
  const Eigen::Vector3d arm = gantry.distant_lamp ? p : Eigen::Vector3d(p - dome.centre);
  const double length = arm.norm();
  if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
  const double off_dome = std::max(gantry.tolerance, 1e-6) * dome.radius;
  if (!gantry.distant_lamp && std::abs(length - dome.radius) > off_dome) return std::nullopt;

  const double horizontal = std::hypot(arm.x(), arm.y());
  const double elevation = std::atan2(arm.z(), horizontal);
  // At the poles every azimuth is right: the one that needs least motion from home.
  const bool at_pole = horizontal < 1e-12 * length;
  const double azimuth = at_pole ? std::clamp(azimuth_axis.home, azimuth_axis.min, azimuth_axis.max)
                                 : std::atan2(arm.y(), arm.x());

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
  consider(at_pole ? azimuth : azimuth + pi, pi - elevation);  // the arc swung over the zenith
  return best;
}

}  // namespace

LightPosition light_at(const GantryModel& gantry, const GantryPosition& position) {
  return std::visit(
      [&](const auto& kinematics) {
        return light_of(kinematics, gantry.distant_lamp, position.axes);
      },
      gantry.kinematics);
}

std::optional<GantryPosition> reach(const GantryModel& gantry, const Eigen::Vector3d& p) {
  return std::visit([&](const auto& kinematics) { return reach_of(kinematics, gantry, p); },
                    gantry.kinematics);
}

bool within_limits(const GantryModel& gantry, const GantryPosition& position) {
  if (position.axes.size() != static_cast<Eigen::Index>(gantry.axes.size())) return false;
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const double value = position.axes[static_cast<Eigen::Index>(i)];
    // Written so that NaN is outside.
    if (!(value >= gantry.axes[i].min && value <= gantry.axes[i].max)) return false;
  }
  return true;
}

double MoveProfile::fraction(double t) const {
  const double total = duration();
  if (t <= 0) return total > 0 ? 0.0 : 1.0;
  if (t >= total) return 1;
  if (t < ramp_time) return acceleration * t * t / 2;
  if (t <= ramp_time + cruise_time) return speed * (t - ramp_time / 2);
  const double left = total - t;
  return 1 - acceleration * left * left / 2;
}

MoveProfile move_profile(const GantryModel& gantry, const GantryPosition& from,
                         const GantryPosition& to) {
  CHECK(from.axes.size() == static_cast<Eigen::Index>(gantry.axes.size()));
  CHECK(to.axes.size() == from.axes.size());
  MoveProfile profile;
  bool moves = false;
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double distance = std::abs(to.axes[row] - from.axes[row]);
    if (!(distance > 0)) continue;
    const double speed = gantry.axes[i].max_speed / distance;
    const double acceleration = gantry.axes[i].max_acceleration / distance;
    profile.speed = moves ? std::min(profile.speed, speed) : speed;
    profile.acceleration = moves ? std::min(profile.acceleration, acceleration) : acceleration;
    moves = true;
  }
  if (!moves) return profile;
  // The full ramps cover speed²/acceleration of the way; a shorter move never reaches full speed.
  if (profile.speed * profile.speed >= profile.acceleration) {
    profile.speed = std::sqrt(profile.acceleration);
    profile.ramp_time = 1 / profile.speed;
  } else {
    profile.ramp_time = profile.speed / profile.acceleration;
    profile.cruise_time = 1 / profile.speed - profile.ramp_time;
  }
  return profile;
}

double move_time(const GantryModel& gantry, const GantryPosition& from, const GantryPosition& to) {
  return move_profile(gantry, from, to).duration();
}

GantryPosition move_position(const GantryModel& gantry, const GantryPosition& from,
                             const GantryPosition& to, double t) {
  const double s = move_profile(gantry, from, to).fraction(t);
  if (s >= 1) return to;
  GantryPosition position;
  position.axes = from.axes + s * (to.axes - from.axes);
  return position;
}

}  // namespace lightrig
