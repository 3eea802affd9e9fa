#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/light.h"
#include "core/result.h"

namespace lightrig {

/// What capturing a set of a study's lights would take on a given rig: every direction becomes the
/// rig's own candidate that comes nearest to it as its camera sees the object, and the stops are
/// visited by the shortest route with the rig's bracket. No photograph is taken and nothing moves.
class RigTime {
 public:
  /// Errors: those of reading the rig file; invalid_input where it has no candidate in reach.
  static Result<RigTime> open(const std::filesystem::path& rig_file,
                              std::span<const LightPosition> directions);

  /// [s] dark frames, moves, settling and exposures, homing apart; indices into `directions`.
  double seconds(std::span<const int> lights) const;

  /// [rad] median angle between a direction asked for and the candidate that stands for it.
  double median_deviation() const { return median_deviation_; }
  const Rig& rig() const { return rig_; }

 private:
  Rig rig_;
  SessionSpec session_;
  std::vector<GantryPosition> stop_;  ///< one per direction
  double median_deviation_ = 0;
};

}  // namespace lightrig
