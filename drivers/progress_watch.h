#pragma once

#include <chrono>

#include "core/gantry_model.h"
#include "drivers/devices.h"

namespace lightrig {

/// Looks on while a gantry moves, so that one that does not do what it was told is stopped then and
/// not at the move's deadline: an axis that goes the wrong way (a sense that is reversed, a
/// coupling that slips), or all of them standing still although the drives say that they move.
class ProgressWatch {
 public:
  /// `model` is borrowed. `patience`: for how long nothing may come nearer; a drive's own ramps and
  /// the brakes before them have to fit in.
  ProgressWatch(const GantryModel& model, GantryPosition from, GantryPosition to, TimePoint begun,
                std::chrono::milliseconds patience = std::chrono::milliseconds(2000));

  /// Takes where the axes are now. Errors: refused for the wrong way, timed_out for standing still.
  Result<void> see(const GantryPosition& position, TimePoint now);

 private:
  const GantryModel& model_;
  const GantryPosition from_, to_;
  const std::chrono::milliseconds patience_;
  AxisValues nearest_;  ///< to the target, of each axis
  TimePoint progress_;
};

}  // namespace lightrig
