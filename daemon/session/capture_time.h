#pragma once

#include <vector>

#include "config/rig.h"
#include "core/plan.h"

namespace lightrig {

/// Rig seconds of one shot by the motion model, every exposure on offer taken.
struct ShotTime {
  int shot = -1;         ///< index into Plan::shots
  double move = 0;       ///< [s] from the stop before
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
CaptureTime capture_time(const Rig& rig, const SessionSpec& spec, const Plan& plan);

/// The exposure on offer that a shot is metered with: the middle one, so that both ends of the
/// bracket can be judged from it.
double metering_exposure(const std::vector<double>& offered);

}  // namespace lightrig
