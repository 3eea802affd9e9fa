#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "config/load_object.h"
#include "config/rig.h"
#include "core/azimuth_model.h"
#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/plan.h"
#include "core/surface_points.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/patience.h"

namespace lightrig {

/// Seconds of one stage of a computation, in the order they ran.
struct StageCost {
  std::string stage;   ///< "mesh", "materials", "basis", "points", "bins", "select", "route", …
  double seconds = 0;  ///< [s] wall time
};

/// All that a session needs before anything moves. Everything after the rig and session files, as
/// values.
struct Prepared {
  LoadedObject object;
  std::shared_ptr<const Occluder> occluder;
  SurfacePoints points;  ///< what extraction looks at; planning counts on its whole pixels alone;
                         ///< on a turntable: as it is homed
  /// On a turntable every shot shows another side of the object: what is then seen, per shot of the
  /// plan. Empty elsewhere. Ask points_of_shot().
  std::vector<SurfacePoints> turned_points;
  std::vector<Material>
      materials;          ///< of the basis (kept for the material distances that reports show)
  BrdfBasis fit_basis;    ///< for reconstruction
  AzimuthModel azimuths;  ///< what φd adds to fit_basis; none() where the materials have no φd
  BrdfBasis plan_basis;   ///< for planning: fit_basis, or its first K components, or stacked
  std::vector<Candidate> candidates;
  std::vector<UnusableCandidate> unusable;  ///< what the rule offered besides
  CandidateBins bins;
  Plan plan;
  std::vector<double> capture_by_lights;  ///< [s] capture_time_by_lights() of a plan just made
  std::vector<StageCost> cost;
  double peak_memory_mib = 0;        ///< of this process so far, once all of this is ready
  std::vector<std::string> remarks;  ///< mesh repairs, materials passed over, candidates left out
};

/// The points that a shot of the plan looks at, in the frame of the object as modelled.
const SurfacePoints& points_of_shot(const Prepared& prepared, int shot);

/// What the camera sees at a position of the gantry.
SurfacePoints points_seen(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                          const GantryPosition& position);

/// Reads what the files name and plans. Errors: invalid_input when the camera does not see the
/// object or no reachable lamp position lights anything it sees, with the counts; refused when no
/// clear way leads to the lights; stopped, once the stage in hand is over. Beats with every stage
/// and every material's file.
Result<Prepared> prepare(const Rig& rig, const SessionSpec& spec, bool brute_force = false,
                         const Patience& patience = {});

/// Everything of prepare() but the plan's choice of lights, which is given (a stored plan, a
/// resumed session).
Result<Prepared> prepare_with_plan(const Rig& rig, const SessionSpec& spec, const Plan& plan,
                                   const Patience& patience = {});

}  // namespace lightrig
