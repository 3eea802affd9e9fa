#pragma once

#include <string>
#include <vector>

#include "config/rig.h"
#include "core/keep_out.h"
#include "core/surface_points.h"

namespace lightrig {

/// Whether hardware moves the lamp while the rig file says of nothing that it is solid.
bool moves_without_body(const Rig& rig);

/// What lamp and arm may not touch: the rig file's keep-out volumes and, where it describes the
/// solid that moves ([gantry.body]), camera, floor and object as well.
struct Obstacles {
  std::vector<Solid> solids;
  std::vector<std::string> names;  ///< (solids)
  GantryBody body;
  double margin = 0;  ///< [m] least distance kept
};
/// `object`: the mesh as posed in the world; nullptr where it is not known. A turntable's is taken
/// as the drum it sweeps.
Obstacles obstacles_of(const Rig& rig, const Mesh* object);

/// Why a lamp position was left out.
enum class NotUsable : std::uint8_t {
  unreachable,  ///< out of the gantry's travel
  kept_out,     ///< lamp or arm touches an obstacle
  in_view,      ///< the lamp shows in the camera's picture
  into_lens,    ///< the lamp shines into the lens
  hides,        ///< lamp or arm stands between camera and object
};
std::string text_of(NotUsable why);

struct UnusableCandidate {
  LightPosition light;  ///< in light_at()'s frame
  NotUsable why;
};

/// Lamp positions that a rig can take, and what was left out of the rule's.
struct CandidateLayout {
  std::vector<Candidate> candidates;
  std::vector<UnusableCandidate> unusable;
  int offered = 0;

  int count(NotUsable why) const;
};

/// Lays out the rig's candidates by its rule, and keeps those that the gantry reaches without lamp
/// or arm touching an obstacle, showing in the camera's picture, standing between camera and
/// object, or shining into the lens. The order is the rule's. Two offers that reach the same axis
/// values are both kept: the planner merges them. `object` as in obstacles_of().
CandidateLayout lay_candidates(const Rig& rig, const Mesh* object = nullptr);

/// Directions of a Fibonacci spiral over the whole sphere, unit, from +z to −z [Swinbank, Purser
/// 2006].
std::vector<Eigen::Vector3d> fibonacci_sphere(int count);

/// The first obstacle that lamp or arm meets on the way, "" when the way is clear, or the axis that
/// leaves its travel. Nothing is missed between the poses looked at (first_contact).
std::string obstacle_on_the_way(const Rig& rig, const Obstacles& obstacles,
                                const GantryPosition& from, const GantryPosition& to);

/// Stops that lead from one position to another clear of every obstacle: the target alone
/// where the direct way is clear, else by way of the candidate that makes it shortest. Errors:
/// refused when there is no such way, naming the volume.
Result<std::vector<GantryPosition>> clear_way(const Rig& rig, const Obstacles& obstacles,
                                              const std::vector<Candidate>& candidates,
                                              const GantryPosition& from, const GantryPosition& to);

/// Where the gantry stands after homing.
GantryPosition home_position(const GantryModel& gantry);

}  // namespace lightrig
