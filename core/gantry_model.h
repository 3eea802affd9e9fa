#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/light.h"

namespace lightrig {

/// Axis coordinates of the gantry, [rad] for rotary, [m] for linear axes; at most six.
using AxisValues = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 6, 1>;

/// Where the gantry is, or should be.
struct GantryPosition {
  AxisValues axes;
};

/// One motorised axis. All of it comes from the rig file; nothing that can hurt has a default.
struct Axis {
  std::string name;
  bool rotary = true;
  double min = 0, max = 0;      ///< [rad] or [m]: travel that any command may use
  double max_speed = 0;         ///< [rad/s] or [m/s]
  double max_acceleration = 0;  ///< [rad/s²] or [m/s²]
  double home = 0;              ///< [rad] or [m]: position after homing
};

/// Lamp on a dome or arc: azimuth and elevation axes about a centre, lamp aimed at it.
/// position = centre + radius (cos e cos a, cos e sin a, sin e).
struct DomeKinematics {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m, world]
  double radius = 0;                                 ///< [m]
};
using Kinematics = std::variant<DomeKinematics>;

struct GantryModel {
  Kinematics kinematics;
  std::vector<Axis> axes;     ///< dome: azimuth, elevation
  bool distant_lamp = false;  ///< the lamp counts as infinitely far in its direction
  double settle_time = 0;     ///< [s] at rest before an exposure
  double tolerance = 0;       ///< [rad] or [m]: arrival means every axis within it
};

/// Where the lamp is at these axis values.
LightPosition light_at(const GantryModel& gantry, const GantryPosition& position);

/// Axis values that bring the lamp to a point [m, world] (distant lamp: to a direction); empty
/// where out of travel.
std::optional<GantryPosition> reach(const GantryModel& gantry, const Eigen::Vector3d& p);

/// Within every axis' travel, and finite.
bool within_limits(const GantryModel& gantry, const GantryPosition& position);

/// Seconds of an acceleration-limited move [s]; the slowest axis counts. Without settling.
double move_time(const GantryModel& gantry, const GantryPosition& from, const GantryPosition& to);

/// Position of a trapezoidal-profile move `t` seconds after its start, axes arriving together [s].
GantryPosition move_position(const GantryModel& gantry, const GantryPosition& from,
                             const GantryPosition& to, double t);

/// A lamp position that the gantry can take.
struct Candidate {
  LightPosition light;
  GantryPosition gantry;
};

}  // namespace lightrig
