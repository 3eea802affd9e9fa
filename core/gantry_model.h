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
/// where out of travel, or where a point lies off the dome by more than the tolerance (at least
/// 1e-6 of the radius). Whole turns are added, and elevations beyond the zenith taken, where the
/// travel has them; of several ways the one nearest to the home position.
std::optional<GantryPosition> reach(const GantryModel& gantry, const Eigen::Vector3d& p);

/// Within every axis' travel, and finite.
bool within_limits(const GantryModel& gantry, const GantryPosition& position);

/// A straight move in axis space: every axis follows from + s(t) (to − from), where s runs from 0
/// to 1 with a trapezoidal speed (triangular when short). The axes start and arrive together and
/// the path does not depend on the dynamics, which is what keep-out checks and coordinated drives
/// need.
struct MoveProfile {
  double speed = 0;         ///< [1/s] of s while cruising: least of max_speed/|Δ| over the axes
  double acceleration = 0;  ///< [1/s²] of s: least of max_acceleration/|Δ| over the axes
  double ramp_time = 0;     ///< [s] of speeding up, and of slowing down
  double cruise_time = 0;   ///< [s] at `speed`; 0 when triangular

  double duration() const { return 2 * ramp_time + cruise_time; }  ///< [s]
  double fraction(double t) const;  ///< s after t seconds: 0 before the start, 1 after the end
};
MoveProfile move_profile(const GantryModel& gantry, const GantryPosition& from,
                         const GantryPosition& to);

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
