#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/camera_model.h"
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
  bool selector = false;        ///< no motion at all: its value is the number of a fixed lamp
};

/// Lamp on a dome or arc: azimuth and elevation axes about a centre, lamp aimed at it.
/// position = centre + radius (cos e cos a, cos e sin a, sin e).
struct DomeKinematics {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m, world]
  double radius = 0;                                 ///< [m]
};

/// Lamp on three linear axes along the world's: position = origin + (x, y, z). It points along
/// `aim`, or, on a head of two more axes, pan p and tilt t, along (cos t cos p, cos t sin p, sin
/// t); the head is used to point at `target`.
struct CartesianKinematics {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< [m, world]
  Eigen::Vector3d aim = -Eigen::Vector3d::UnitZ();   ///< unit; of a head that does not turn
  bool head = false;                                 ///< axes 3 and 4 are pan and tilt
  Eigen::Vector3d target = Eigen::Vector3d::Zero();  ///< [m, world]; with a head
};

/// The object turns by axis 0 about the vertical through `centre`, counter-clockwise seen from
/// above. Camera and lamp stand: the lamp at centre + radius (cos e cos a, cos e sin a, sin e),
/// aimed at the centre, with a fixed azimuth a, and e fixed or axis 1. As the camera sees it the
/// lamp never turns: only another part of the object comes under it.
struct TurntableKinematics {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m, world]
  double radius = 0;                                 ///< [m]
  double azimuth = 0, elevation = 0;                 ///< [rad] of the lamp
  bool arm = false;                                  ///< axis 1 is the lamp's elevation
};

/// Fixed lamps, one lit at a time: a ring or a dome of them. Nothing moves; the one "axis" is a
/// selector.
struct FixedLampsKinematics {
  std::vector<Eigen::Vector3d> lamps;                ///< [m, world]
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m, world]: what all are aimed at
};

using Kinematics =
    std::variant<DomeKinematics, CartesianKinematics, TurntableKinematics, FixedLampsKinematics>;

struct GantryModel {
  Kinematics kinematics;
  std::vector<Axis> axes;       ///< in the order that the kinematics state
  bool distant_lamp = false;    ///< the lamp counts as infinitely far in its direction
  double settle_time = 0;       ///< [s] at rest before an exposure
  double tolerance = 0;         ///< [rad]: arrival means every rotary axis within it
  double linear_tolerance = 0;  ///< [m]: and every linear one within this
  EmissionLobe lobe = {};       ///< of the lamp
};

/// How an axis is spoken of outside: "deg", "mm", or "" for a choice among lamps; `per_si` of them
/// are one radian, one metre, one lamp.
struct AxisUnit {
  std::string_view name;
  double per_si = 1;
};
AxisUnit unit_of(const Axis& axis);

/// "12.5000°", "87.500 mm", "lamp 3": a value of this axis for people, with so many decimals (of a
/// millimetre one fewer).
std::string value_text(const Axis& axis, double value, int decimals);

/// Arrival tolerance of one axis [rad] or [m].
double tolerance_of(const GantryModel& gantry, std::size_t axis);

/// Every axis within its tolerance of where it should be.
bool arrived(const GantryModel& gantry, const GantryPosition& at, const GantryPosition& target);

/// Where the modelled object is at these axis values, in the world: turned on a turntable, else
/// where it was modelled.
Eigen::Isometry3d object_turn(const GantryModel& gantry, const GantryPosition& position);

/// The camera as the object sees it: on a turntable it goes round. With light_at(), which is in the
/// same frame, everything that is computed about an unturned object holds for a turned one.
CameraModel camera_at(const GantryModel& gantry, const CameraModel& camera,
                      const GantryPosition& position);

/// Whether positions differ in how the camera sees the object.
bool turns_object(const GantryModel& gantry);

/// Where the lamp is at these axis values, in the frame of the object as modelled: the world, but
/// on a turntable the lamp goes round against the object's turn.
LightPosition light_at(const GantryModel& gantry, const GantryPosition& position);

/// Axis values that bring the lamp to a point [m] of light_at()'s frame (distant lamp: to a
/// direction); empty where out of travel, or where a point lies off the dome by more than the
/// tolerance (at least 1e-6 of the radius) or is no fixed lamp's (1 µm). Whole turns are added, and
/// elevations beyond the zenith taken, where the travel has them; of several ways the one nearest
/// to the home position.
std::optional<GantryPosition> reach(const GantryModel& gantry, const Eigen::Vector3d& p);

/// Within every axis' travel, and finite; a selector names a lamp.
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
