#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "core/camera_model.h"
#include "core/gantry_model.h"

namespace lightrig {

/// A volume where lamp and arm may not go [m, world].
struct Ball {
  Eigen::Vector3d centre;
  double radius = 0;
};
struct Box {
  Eigen::Vector3d min, max;
};
using Solid = std::variant<Ball, Box>;

/// The solid that moves with the lamp: a ball around the lamp, a straight boom from it (outwards
/// from the centre; on linear axes along `boom_direction`), and a mast from the boom's end to a
/// foot that turns with the azimuth (a turntable's lamp: stands at its azimuth; linear axes: none).
/// All zero is a lamp that is a point.
struct GantryBody {
  double lamp_radius = 0;                                     ///< [m]
  double boom_length = 0;                                     ///< [m]
  double boom_radius = 0;                                     ///< [m] of boom and mast
  std::optional<Eigen::Vector3d> mast_foot;                   ///< [m] from the centre, at azimuth 0
  Eigen::Vector3d boom_direction = Eigen::Vector3d::UnitZ();  ///< unit
};

/// All points within `radius` of the segment from a to b [m, world]; a ball where a = b.
struct Capsule {
  Eigen::Vector3d a, b;
  double radius = 0;
};

/// What moves, at these axis values: the lamp first, then the boom and the mast where there are
/// any. In the world, on a turntable too. A distant lamp's body is where the gantry really holds
/// it.
std::vector<Capsule> body_at(const GantryModel& gantry, const GantryBody& body,
                             const GantryPosition& position);

/// Distance between surfaces [m]; negative where they overlap (then a bound, not a depth).
double clearance(const Capsule& body, const Solid& volume);

/// The volume that a body comes closest to.
struct Clearance {
  double distance = 0;     ///< [m]; infinite without volumes
  std::size_t volume = 0;  ///< index
};
Clearance clearance(const GantryModel& gantry, const GantryBody& body,
                    const GantryPosition& position, std::span<const Solid> volumes);

/// Where a move first comes too close.
struct Contact {
  std::size_t volume = 0;  ///< index
  GantryPosition position;
};

/// The first contact on the straight way in axis space (move_position) from one position to
/// another; empty when the whole sweep of lamp, boom and mast stays further than `margin` [m] from
/// every volume. By conservative advancement [Mirtich 1996]: from a pose with clearance c, no point
/// of the body can reach a volume before it has travelled c, so nothing is missed between the poses
/// looked at. Ways that stay within margin + 0.1 mm may be reported as contact.
std::optional<Contact> first_contact(const GantryModel& gantry, const GantryBody& body,
                                     const GantryPosition& from, const GantryPosition& to,
                                     std::span<const Solid> volumes, double margin);

/// Whether a body may show in the camera's picture, and so hide the object or dazzle the camera.
/// Never false for a body of which a point projects into the picture; may be true for one that just
/// misses a corner.
bool in_view(const CameraModel& camera, const Capsule& body);

/// Whether a body may stand between the camera and a box, and so hide part of what is in it. Never
/// false for a body of which a point lies on a line of sight to a point of the box.
bool hides(const CameraModel& camera, const Capsule& body, const Box& box);

/// Whether a lamp shines into the lens: it lies within `cone` [rad] of the line of sight as the
/// camera's eye sees it (a distant camera: its direction does) and lights that way. What stands in
/// between is not looked at.
bool shines_into_lens(const CameraModel& camera, const LightPosition& light, double cone);

}  // namespace lightrig
