// The session thread: it serves the command slot, and it alone touches the devices.
#include <fmt/format.h>
#include <malloc.h>

#include <cmath>
#include <numbers>
#include <utility>

#include "daemon/service/service.h"
#include "daemon/service/status_json.h"
#include "daemon/session/guarded_move.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr auto idle_look = 2s;        ///< between two looks at an armed rig that does nothing
constexpr auto idle_promise = 60s;    ///< a look that hangs longer than this is a hang
constexpr auto short_promise = 120s;  ///< opening devices, asking them, closing them

std::chrono::nanoseconds nanoseconds_of(double seconds) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds));
}

std::string in_rig_units(const Axis& axis, double value) { return value_text(axis, value, 3); }

}  // namespace

void Service::run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    liveness_.promise(idle_promise);
    changed_.wait_for(lock, idle_look, [this] { return stopping_ || slot_ || !is_armed(state_); });
    if (stopping_) break;
    if (slot_) {
      // From the slot to the hand under one lock: an ABORT finds the command in either.
      Command command = std::move(*slot_);
      slot_.reset();
      active_ = command.control.get();
      lock.unlock();
      execute(command);
    } else {
      lock.unlock();
      idle_check();
    }
    settle_devices();
    lock.lock();
    // Unarmed and nothing to do: sleep until somebody asks for something.
    if (!is_armed(state_) && !slot_ && !stopping_)
      changed_.wait_for(lock, idle_promise / 4, [this] { return stopping_ || slot_; });
  }
  lock.unlock();
  lamp_unsure(!access_.close());
}

// A command that was stopped before anything moved. An abort has set the state itself.
Result<std::string> Service::not_begun(const SessionControl& control, const std::string& what) {
  const std::string reason = control.reason() + "; nothing had moved";
  // One that waited before it was resumed waits again; any other is as it was before.
  const State now = snapshot().state;
  const bool waits = now == State::capturing || now == State::paused;
  if (control.halted()) apply(Event::halted, reason, {waits ? "" : "halted", "person"});
  return fail(ErrorCode::stopped, what + ": " + reason);
}

void Service::execute(const Command& command) {
  SessionControl& control = *command.control;
  const Result<std::string> end = control.stop_token().stop_requested()
                                      ? not_begun(control, command.name)
                                      : command.work(control);
  bool of_a_session = false;
  {
    const std::lock_guard lock(mutex_);
    of_a_session = session_in_hand_;
  }
  // Every arena keeps what its threads once held: after a night's sessions an idle service held
  // 180 MiB.
  if (of_a_session) ::malloc_trim(0);
  {
    const std::lock_guard lock(mutex_);
    active_ = nullptr;
    aborted_.command = nullptr;
    session_in_hand_ = false;
    settle_steering();
  }
  record_end(command.id, end);
}

// A rig that is not armed has no open device: lamp dark, motion stopped, nothing held.
void Service::settle_devices() {
  {
    const std::lock_guard lock(mutex_);
    if (is_armed(state_)) return;
    facts_.reset();
  }
  if (!access_.is_open()) return;
  const bool dark = access_.close();
  lamp_unsure(!dark);
  log_.info("devices_closed", {{"lamp", dark ? "dark" : "MAY BE ON"}});
  tell_state();
}

void Service::lamp_unsure(bool unsure) {
  if (!unsure) return;  // only a lamp that was confirmed dark after arming clears the doubt
  const std::lock_guard lock(mutex_);
  lamp_may_be_on_ = true;
}

void Service::remember(const RigFacts& facts) {
  const std::lock_guard lock(mutex_);
  facts_ = facts;
}

// An armed rig that does nothing is looked at: an alarm, a lost wire or an arm that moved by
// itself ends its being armed.
void Service::idle_check() {
  std::optional<RigFacts> before;
  {
    const std::lock_guard lock(mutex_);
    if ((state_ != State::armed && state_ != State::done) || !access_.is_open()) return;
    before = facts_;
  }
  liveness_.promise(short_promise);
  if (auto dark = access_.heed_lease(); !dark) {
    lamp_unsure(true);
    apply(Event::fault, dark.error().message);
    return;
  }
  const auto now = access_.facts({});
  if (!now) {
    apply(Event::fault, "the rig no longer answers: " + now.error().message);
    return;
  }
  remember(*now);
  if (!now->gantry.alarm.empty()) {
    apply(Event::fault, "the gantry reports an alarm: " + now->gantry.alarm);
    return;
  }
  if (!before || before->gantry.position.axes.size() != now->gantry.position.axes.size()) return;
  const bool stayed =
      arrived(settings_.rig.gantry.model, now->gantry.position, before->gantry.position);
  if (now->gantry.homed && before->gantry.homed && !stayed)
    apply(Event::fault, "the gantry moved although nothing told it to; look at it, then home it");
}

Result<std::string> Service::do_arm(SessionControl& control) {
  liveness_.promise(short_promise);
  auto facts = access_.open(object_, control.stop_token());
  if (facts || !control.stop_token().stop_requested()) opened(facts);
  if (!facts) return tl::unexpected(with_context("arm the rig", facts.error()));
  if (!facts->gantry.alarm.empty()) {
    // Arming is the deliberate act that a latched alarm waits for; one that stays refuses it.
    auto cleared = access_.clear_fault(control.stop_token());
    if (cleared) facts = access_.facts_at_rest(control.stop_token());
    if (!cleared || !facts || !facts->gantry.alarm.empty())
      return fail(ErrorCode::refused,
                  fmt::format("arm the rig: the gantry's alarm stays ({}); mend its cause",
                              facts ? facts->gantry.alarm : facts.error().message));
  }
  if (!facts->gantry.open_interlocks.empty())
    return fail(ErrorCode::refused, fmt::format("arm the rig: interlock {} is open; close it",
                                                facts->gantry.open_interlocks.front()));
  remember(*facts);
  // Loaded now, and not while somebody waits for a jog, perhaps with the lamp lit.
  if (auto known = access_.know_obstacles(); !known)
    log_.warning("no_jogs", {{"reason", known.error().message}});
  if (!apply_unless_stopped(Event::arm, control))
    return fail(ErrorCode::stopped, "arm the rig: aborted; the rig stays unarmed");
  {
    const std::lock_guard lock(mutex_);
    lamp_may_be_on_ = false;
  }
  log_.info("armed", {{"simulated", settings_.simulate ? "true" : "false"},
                      {"camera", facts->camera},
                      {"homed", facts->gantry.homed ? "true" : "false"}});
  return "the rig is armed";
}

// A lamp that a person lit for a look burns on its lease, which nobody heeds while the session
// thread plans or homes.
Result<void> Service::darken() {
  if (!access_.is_open()) return {};
  const auto dark = access_.set_lamp(0, {});
  if (dark) return {};
  lamp_unsure(true);
  apply(Event::fault, dark.error().message);
  return tl::unexpected(with_context("make the lamp dark first", dark.error()));
}

Result<std::string> Service::do_home(SessionControl& control) {
  if (auto dark = darken(); !dark) return tl::unexpected(dark.error());
  liveness_.promise(settings_.rig.gantry.homing_timeout + short_promise);
  auto homed = access_.home(control.stop_token());
  if (!homed) {
    // An abort has set the state already; neither that nor a halt is a fault.
    if (control.halted()) {
      apply(Event::halted, control.reason());
    } else if (!control.stop_token().stop_requested()) {
      if (homed.error().code == ErrorCode::refused)
        apply(Event::homed);  // it was not begun: still armed, and the reason is in the record
      else
        apply(Event::fault, homed.error().message);
    }
    return tl::unexpected(homed.error());
  }
  if (auto facts = access_.facts(control.stop_token())) remember(*facts);
  if (!apply_unless_stopped(Event::homed, control)) {
    if (control.halted()) apply(Event::halted, control.reason());
    return fail(ErrorCode::stopped, "home the gantry: " + control.reason());
  }
  return "the gantry is homed";
}

Result<std::string> Service::do_jog(SessionControl& control, const std::string& name, double value,
                                    bool relative) {
  const auto& axes = settings_.rig.gantry.model.axes;
  std::size_t index = 0;
  while (index < axes.size() && axes[index].name != name) ++index;
  if (index == axes.size()) {
    std::string known;
    for (const Axis& axis : axes) known += (known.empty() ? "" : ", ") + axis.name;
    return fail(ErrorCode::invalid_input,
                fmt::format("jog: the rig has no axis \"{}\"; it has {}", name, known));
  }
  liveness_.promise(longest_step());
  auto now = access_.facts(control.stop_token());
  if (!now) return tl::unexpected(with_context("jog", now.error()));
  GantryPosition target = now->gantry.position;
  const auto i = static_cast<Eigen::Index>(index);
  target.axes[i] = relative ? target.axes[i] + value : value;
  const Axis& axis = axes[index];
  if (!std::isfinite(target.axes[i]) || target.axes[i] < axis.min || target.axes[i] > axis.max)
    return fail(ErrorCode::refused,
                fmt::format("jog: {} to {} is outside its travel of {} … {}; nothing was moved",
                            axis.name, in_rig_units(axis, target.axes[i]),
                            in_rig_units(axis, axis.min), in_rig_units(axis, axis.max)));
  const auto longest = longest_move(settings_.rig, now->gantry.position, target);
  const bool dark_first = !access_.lease_covers(longest);
  if (dark_first) {
    if (auto dark = darken(); !dark) return tl::unexpected(dark.error());
    log_.info("lamp_dark", {{"reason", "its lease may end before the jog does"}});
  }
  auto moved = access_.move_to(target, control.stop_token());
  if (auto after = access_.facts({})) remember(*after);
  if (!moved) {
    const bool by_us = control.stop_token().stop_requested();
    if (!by_us && moved.error().code != ErrorCode::refused)
      apply(Event::fault, moved.error().message);
    return tl::unexpected(with_context("jog", moved.error()));
  }
  return fmt::format("{} is at {}{}", axis.name, in_rig_units(axis, target.axes[i]),
                     dark_first ? "; the lamp was made dark first, its max_on_time_s might have "
                                  "ended on the way"
                                : "");
}

Result<std::string> Service::do_lamp(SessionControl& control, double power) {
  liveness_.promise(short_promise);
  const auto state = access_.set_lamp(power, control.stop_token());
  if (auto after = access_.facts({})) remember(*after);
  if (!state) return tl::unexpected(state.error());
  const double seconds = std::chrono::duration<double>(settings_.rig.lamp.max_on_time).count();
  return fmt::format(
      "the lamp is {}{}{}",
      state->power > 0 ? fmt::format("at {:.0f} %", 100 * state->power) : "dark",
      state->confirmed ? ", read back" : ", as told: it cannot be read back",
      state->power > 0 ? fmt::format("; it goes dark by itself after {} s", seconds) : "");
}

Result<std::string> Service::do_snap(SessionControl& control, double exposure, bool lit) {
  liveness_.promise(longest_step());
  const std::stop_token stop = control.stop_token();
  Result<Frame> frame = fail(ErrorCode::stopped, "snap: stopped");
  Result<LampState> lamp = LampState{};
  if (lit) lamp = access_.set_lamp(settings_.rig.lamp.power, stop);
  const std::chrono::nanoseconds warm_up = lit ? nanoseconds_of(settings_.rig.lamp.warm_up) : 0ns;
  // Nobody heeds a lease while the camera exposes.
  if (lamp && !access_.lease_covers(warm_up + nanoseconds_of(exposure)))
    lamp = fail(ErrorCode::refused,
                fmt::format("snap: the lamp's max_on_time_s ends before {} would{}",
                            lit ? "warming up and the exposure" : "the exposure",
                            lit ? "" : "; set the lamp anew first"));
  if (lamp) {
    if (lit) access_.clock().sleep_until(access_.clock().now() + warm_up, stop);
    if (!stop.stop_requested()) frame = access_.expose(exposure, stop);
  }
  // Dark on every path, whether or not a stop was asked for.
  if (lit)
    if (auto dark = access_.set_lamp(0, {}); !dark) {
      lamp_unsure(true);
      apply(Event::fault, dark.error().message);
      return tl::unexpected(dark.error());
    }
  if (auto after = access_.facts({})) remember(*after);
  if (!lamp) return tl::unexpected(lamp.error());
  if (!frame) return tl::unexpected(with_context("snap", frame.error()));
  hub_.update("preview", preview_json(preview_.offer(*frame, "snap")));
  return fmt::format("a frame of {:.6g} s is taken; GET /v1/preview shows it", frame->exposure);
}

}  // namespace lightrig
