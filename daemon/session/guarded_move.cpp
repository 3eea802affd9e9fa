#include "daemon/session/guarded_move.h"

#include <fmt/format.h>

#include <chrono>

namespace lightrig {
namespace {

Result<void> refuse(const std::string& why) {
  return fail(ErrorCode::refused, why + "; nothing was moved");
}

}  // namespace

std::string obstacle(const GantryStatus& now) {
  if (!now.alarm.empty())
    return fmt::format("the gantry reports an alarm ({}); mend its cause, then clear it",
                       now.alarm);
  if (!now.open_interlocks.empty())
    return fmt::format("open: {}; close it first", fmt::join(now.open_interlocks, ", "));
  return {};
}

std::chrono::nanoseconds longest_move(const Rig& rig, const GantryPosition& from,
                                      const GantryPosition& to) {
  const std::chrono::duration<double> predicted(move_time(rig.gantry.model, from, to) *
                                                rig.gantry.move_time_factor);
  return std::chrono::duration_cast<std::chrono::nanoseconds>(predicted) +
         rig.gantry.move_time_margin;
}

Result<void> guarded_move(const Rig& rig, const Obstacles& obstacles, Gantry& gantry,
                          const GantryStatus& now, const GantryPosition& target, Clock& clock,
                          const std::stop_token& stop) {
  const GantryModel& model = rig.gantry.model;
  if (!now.homed) return refuse("it is not homed, so its position is unknown; home it first");
  if (const std::string why = obstacle(now); !why.empty()) return refuse(why);
  if (!now.at_rest) return refuse("it is moving");
  if (!within_limits(model, target))
    return refuse("the target is outside the travel that the rig file allows");
  const std::string volume = obstacle_on_the_way(rig, obstacles, now.position, target);
  if (!volume.empty()) return refuse("the way leads through " + volume);
  return gantry.move_to(target, {clock.now() + longest_move(rig, now.position, target), stop});
}

}  // namespace lightrig
