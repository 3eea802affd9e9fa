#pragma once

#include <string>
#include <vector>

#include "config/rig.h"
#include "core/surface_points.h"

namespace lightrig {

/// Lamp positions that a rig can take, and what was left out of the rule's.
struct CandidateLayout {
  std::vector<Candidate> candidates;
  int offered = 0;
  int unreachable = 0;  ///< out of the gantry's travel
  int kept_out = 0;     ///< in a keep-out volume, or in the camera's picture
};

/// Lays out the rig's candidates by its rule, and keeps those that the gantry reaches outside every
/// keep-out volume and outside the camera's picture (a near lamp there would hide the object or
/// dazzle the camera). The order is the rule's. Two offers that reach the same axis values are both
/// kept: the planner merges them.
CandidateLayout lay_candidates(const Rig& rig);

/// Directions of a Fibonacci spiral over the whole sphere, unit, from +z to −z [Swinbank, Purser
/// 2006].
std::vector<Eigen::Vector3d> fibonacci_sphere(int count);

/// The first keep-out volume that holds this lamp position, or "".
std::string keep_out_at(const Rig& rig, const LightPosition& light);

/// The first keep-out volume that the lamp passes through on the way, "" when the way is clear, or
/// the axis that leaves its travel. Nothing is missed between the poses looked at (first_contact).
std::string obstacle_on_the_way(const Rig& rig, const GantryPosition& from,
                                const GantryPosition& to);

/// Stops that lead from one position to another clear of every keep-out volume: the target alone
/// where the direct way is clear, else by way of the candidate that makes it shortest. Errors:
/// refused when there is no such way, naming the volume.
Result<std::vector<GantryPosition>> clear_way(const Rig& rig,
                                              const std::vector<Candidate>& candidates,
                                              const GantryPosition& from, const GantryPosition& to);

/// Where the gantry stands after homing.
GantryPosition home_position(const GantryModel& gantry);

}  // namespace lightrig
