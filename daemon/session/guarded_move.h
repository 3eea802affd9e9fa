#pragma once

#include <chrono>
#include <stop_token>
#include <string>

#include "config/rig.h"
#include "daemon/session/lay_candidates.h"
#include "drivers/clock.h"
#include "drivers/devices.h"

namespace lightrig {

/// What forbids any motion and any light now, in words: an alarm, an open interlock. "" when
/// nothing does.
std::string obstacle(const GantryStatus& now);

/// The rig file's deadline of a move: the longest that it may take.
std::chrono::nanoseconds longest_move(const Rig& rig, const GantryPosition& from,
                                      const GantryPosition& to);

/// Drives straight to a position. Every motion but homing goes through here, whoever commands it:
/// it is refused unless the gantry, as `now` says, is homed, at rest and without alarm or open
/// interlock, and unless the target lies within the travel and the whole way keeps clear of the
/// obstacles. The deadline is the rig file's for a way so long. Errors: refused with the reason,
/// nothing was moved; those of the gantry.
Result<void> guarded_move(const Rig& rig, const Obstacles& obstacles, Gantry& gantry,
                          const GantryStatus& now, const GantryPosition& target, Clock& clock,
                          const std::stop_token& stop);

}  // namespace lightrig
