#include "core/gantry_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"

namespace lightrig {

AxisUnit unit_of(const Axis& axis) {
  if (axis.selector) return {"", 1};
  if (axis.rotary) return {"deg", 180 / std::numbers::pi};
  return {"mm", 1e3};
}

std::string value_text(const Axis& axis, double value, int decimals) {
  if (axis.selector) return fmt::format("lamp {}", std::lround(value) + 1);
  const double shown = value * unit_of(axis).per_si;
  if (axis.rotary) return fmt::format("{:.{}f}°", shown, decimals);
  return fmt::format("{:.{}f} mm", shown, std::max(1, decimals - 1));
}

double tolerance_of(const GantryModel& gantry, std::size_t axis) {
  if (gantry.axes[axis].selector) return 0;
  return gantry.axes[axis].rotary ? gantry.tolerance : gantry.linear_tolerance;
}

bool arrived(const GantryModel& gantry, const GantryPosition& at, const GantryPosition& target) {
  if (at.axes.size() != target.axes.size()) return false;
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    // Written so that NaN has not arrived.
    if (!(std::abs(at.axes[row] - target.axes[row]) <= tolerance_of(gantry, i))) return false;
  }
  return true;
}

bool within_limits(const GantryModel& gantry, const GantryPosition& position) {
  if (position.axes.size() != static_cast<Eigen::Index>(gantry.axes.size())) return false;
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const double value = position.axes[static_cast<Eigen::Index>(i)];
    // Written so that NaN is outside.
    if (!(value >= gantry.axes[i].min && value <= gantry.axes[i].max)) return false;
    if (gantry.axes[i].selector && value != std::round(value)) return false;
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
    if (!(distance > 0) || gantry.axes[i].selector) continue;
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
