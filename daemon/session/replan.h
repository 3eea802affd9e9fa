#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "config/rig.h"
#include "core/samples.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// What a captured light gave of the bins that the plan counted on.
struct LightYield {
  int shot = -1;    ///< into Plan::shots
  int planned = 0;  ///< bins the plan counted on
  /// Of these, without a value in any channel: for too much light, for too little, and for any
  /// other reason (blocked, or left out as a pixel that mixes radiances).
  int saturated = 0, dark = 0, missing = 0;
  std::vector<double> weight;          ///< (cells) worth of a row the plan counts on, [0, 1]
  std::vector<std::uint8_t> had;       ///< (cells) 1: values in half of the channels or more
  std::vector<std::uint8_t> hopeless;  ///< (cells) 1: saturated or dark, as it would be again
  std::vector<std::uint8_t> absent;    ///< (cells) 1: planned and not there at all

  int lost() const { return saturated + dark + missing; }
};

/// `channels` of the camera; a bin's worth is the mean over them of σ²/(σ² + v), v its variance.
LightYield yield_of(const Prepared& prepared, int shot, const BrdfObservations& observed,
                    int channels);

/// Lights in place of some that are still to be taken.
struct Replan {
  std::vector<std::pair<int, SelectedLight>> lights;  ///< index into Plan::shots, what stands there
  double planned_percent = 0;  ///< predicted error with the lights as they were planned
  double percent = 0;          ///< with these
};

/// What is taken, and what may still be changed; indices into Plan::shots.
struct ReplanQuestion {
  std::size_t yields = 0;    ///< of the lights captured so far, so many count
  std::vector<int> in_hand;  ///< will be captured as they are: taken, or asked for by a person
  std::vector<int> open;     ///< may be replaced
};

/// Whether the last of these lights lost so much that the rest of the plan is worth a second look.
bool lost_rows(const LightYield& yield);

/// Other lights for those still open, by the session's own criterion from the rows really had, with
/// their true variances; empty unless the last light lost rows and other lights promise at least 2
/// % less of what the criterion measures. Bins that were too bright or too dark are counted on no
/// more, whatever the light; those that were absent not in lights within 15° of the one that lost
/// them, where the same thing is in the way; and where that light was without three quarters of its
/// bins, its neighbours are counted on for none at all. A held-out light is never chosen nor
/// replaced, and none within 10° of one. As many lights as there were: the minutes stay.
std::optional<Replan> replan(const Prepared& prepared, const SessionSpec& spec,
                             std::span<const LightYield> yields, const ReplanQuestion& question,
                             int threads);

/// Puts the lights of a replan into the plan, and lays the rest of the way anew: first the lights
/// of `done`, in their order, then the quickest way round the others, or their order of worth where
/// the session may stop early.
void take_up(const Rig& rig, const SessionSpec& spec, const Replan& changes,
             std::span<const int> done, Prepared& prepared);

/// "31 of 120 bins lost (20 blocked or mixed, 8 too bright, 3 too dark)".
std::string describe(const LightYield& yield);

}  // namespace lightrig
