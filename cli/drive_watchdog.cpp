#include "cli/drive_watchdog.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <thread>

#include "cli/held_process.h"

namespace lightrig::cli {
namespace {

using namespace std::chrono_literals;
using SteadyClock = std::chrono::steady_clock;

constexpr double longest_hold = 20;  // [s] systemd's watchdog takes 30

/// What was seen of the rig when the service was held and let go on.
struct Hold {
  std::string why_not;   ///< it could not be held in a move; "" where it was
  bool lamp_lit = true;  ///< when it was held
};

// A move, and amid it a service that hangs for longer than the drives wait.
Hold hold_in_a_move(const RigUnderTest& rig, const FileDescriptor& process, double patience) {
  const auto moving = rig.long_move();
  std::this_thread::sleep_for(500ms);  // up to speed
  if (moving && !*moving) return {moving->error().message};
  const Json now = rig.status();
  if (!now.value("busy", false)) return {"the move was over before it was held"};
  const bool lit = number(part(part(now, "devices"), "lamp"), "power") > 0;
  const HeldProcess held(process, std::chrono::duration<double>(patience) + 3s);
  if (held.why_not().empty())
    std::this_thread::sleep_for(std::chrono::duration<double>(patience) + 1s);
  return {held.why_not(), lit};
}

// Let go on, the service hears of it from the drives: their alarm is the proof.
Finding heard_of_it(const RigUnderTest& rig, double patience, bool lamp_lit) {
  const auto latest = SteadyClock::now() + 30s;
  Json now = rig.status();
  while (SteadyClock::now() < latest && text(now, "state") != "faulted") {
    std::this_thread::sleep_for(100ms);
    now = rig.status();
  }
  if (text(now, "state") != "faulted") {
    (void)rig.post("/v1/abort", {{"reason", "commissioning"}});
    return failed(
        fmt::format("held for {:.1f} s, which is longer than the {:.1f} s of their watchdog, and "
                    "the drives say nothing of it",
                    patience + 1, patience));
  }
  std::string said;
  for (const Json& reason : part(now, "why_not_ready"))
    said += (said.empty() ? "" : "; ") + reason.get<std::string>();
  if (auto cleared = rig.carry_out("/v1/clear"); !cleared) return failed(cleared.error().message);
  if (said.find("alarm") == std::string::npos)
    return failed("the rig faulted, but by no alarm of the drives: " + said);
  const std::string measured = fmt::format("held for {:.1f} s: {}", patience + 1, said);
  if (lamp_lit) return rig.seen(measured, "Did the arm stop by itself, and did the lamp go dark?");
  return not_proven(measured +
                    "; but the lamp was dark by then: its max_on_time_s is shorter than this move "
                    "may take, so that nobody could see it go dark");
}

}  // namespace

Finding drive_watchdog(const RigUnderTest& rig, bool unasked) {
  const double patience = number(rig.facts(), "drive_watchdog_s");
  if (!std::isfinite(patience))
    return absent(
        "these drives have none that the rig file names: a service that hangs leaves the arm to "
        "end its move and the lamp lit until systemd's watchdog ends it; have a hard-wired stop");
  if (!rig.asks() && !unasked)
    return not_proven(
        "it takes a hand on the emergency stop: while the service is held its ABORT does nothing. "
        "--try-watchdog does it unasked");
  if (patience > longest_hold)
    return not_proven(
        fmt::format("{:.0f} s of silence are more than the service may be held, {:.0f} s, before "
                    "systemd ends it: shorten the watchdog",
                    patience, longest_hold));
  const auto process =
      serving_process(rig.socket(), static_cast<pid_t>(whole(rig.facts(), "process")));
  if (!process) return not_proven(process.error().message);
  if (auto ready = rig.armed_and_homed(); !ready) return failed(ready.error().message);
  if (!rig.person_says(fmt::format(
          "The arm will move with the lamp lit while the service is held for {:.0f} s: ABORT, door "
          "and lease do nothing meanwhile, and the drives must stop by themselves. Is everybody "
          "clear, and a hand on the emergency stop?",
          patience + 1)))
    return failed("a person says that it is not safe to move");
  if (auto lit = rig.carry_out("/v1/lamp", {{"power", rig.power()}}); !lit)
    return failed(lit.error().message);
  const Hold hold = hold_in_a_move(rig, *process, patience);
  if (!hold.why_not.empty()) {  // nothing is left lit or moving
    (void)rig.post("/v1/abort", {{"reason", "commissioning"}});
    return not_proven(hold.why_not);
  }
  return heard_of_it(rig, patience, hold.lamp_lit);
}

}  // namespace lightrig::cli
