#pragma once

#include <cstdint>
#include <vector>

#include "config/rig.h"
#include "core/mesh.h"
#include "core/plan.h"

namespace lightrig {

/// Rig seconds of one shot by the motion model, every exposure on offer taken.
struct ShotTime {
  int shot = -1;  ///< index into Plan::shots
  /// Stops from the one before to its own, that included; empty where no way leads there clear of
  /// every obstacle, which the capture will refuse.
  std::vector<GantryPosition> way;
  double move = 0;       ///< [s] along the way, or straight where there is none
  double settle = 0;     ///< [s]
  double warm_up = 0;    ///< [s]
  double exposures = 0;  ///< [s] ambient, metering and bracket, with readout
  double total() const { return move + settle + warm_up + exposures; }
};

/// What a capture takes, step by step, in visiting order. Homing is not in it: the rig file does
/// not say how long that takes.
struct CaptureTime {
  double dark = 0;  ///< [s] dark frames
  std::vector<ShotTime> shots;
  double total() const;
};
/// `object`: the mesh that ways go round, as in obstacles_of(); nullptr where it is not known.
CaptureTime capture_time(const Rig& rig, const SessionSpec& spec, const Plan& plan,
                         const Mesh* object);

/// [s] For the first light alone, the first two as they were chosen … all of them: what capturing
/// so many takes, the held-out ones among them, in the order that a session would visit them.
std::vector<double> capture_time_by_lights(const Rig& rig, const SessionSpec& spec,
                                           const Plan& plan, const Mesh* object);

/// Between which values an axis stands and passes, from home on [rad or m].
struct AxisRange {
  double least = 0, most = 0;
};
std::vector<AxisRange> axis_ranges(const GantryModel& gantry, const CaptureTime& time);

/// What a session stores at most: a dark frame for every exposure on offer and, for every shot, one
/// without the lamp and its bracket, of which the metering frame is one, two bytes a site; and the
/// radiance that reducing leaves of every shot, twelve bytes a site. Before compression.
struct SessionSize {
  std::int64_t frames = 0;
  double bytes = 0;
};
SessionSize largest_session(const Rig& rig, const SessionSpec& spec, const Plan& plan);

/// The exposure on offer that a shot is metered with: the middle one, so that both ends of the
/// bracket can be judged from it.
double metering_exposure(const std::vector<double>& offered);

}  // namespace lightrig
