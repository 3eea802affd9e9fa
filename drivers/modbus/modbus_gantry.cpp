// A gantry of Modbus drives: coordinated moves, arrival that cannot be fooled.
#include "drivers/modbus/modbus_gantry.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <thread>

#include "drivers/progress_watch.h"

namespace lightrig {
namespace {

constexpr std::chrono::milliseconds poll_interval{20};
/// In the middle of a long move, where nothing but an alarm can come.
constexpr std::chrono::milliseconds slow_poll_interval{100};
/// Besides the profile's minimum delay: brakes, ramps.
constexpr std::chrono::milliseconds stall_patience{2000};
/// From being switched on, or from the end of a motion, until a drive says that it is ready: a
/// brake has to open, a drive's own scan to come round.
constexpr std::chrono::milliseconds ready_patience{2000};

}  // namespace

// The stop is sent to every drive, whatever becomes of the others and whatever state its wire is
// in, with a deadline of its own, after any stop request. Each wire is told by a thread of its own:
// a host that does not answer keeps no other's drives moving.
void ModbusGantryDevice::tell_to_stop() {
  if (motion_ == Motion::none) return;
  std::map<const ModbusBus*, std::vector<ModbusDriveDevice*>> wires;
  for (ModbusDriveDevice& drive : controller_->drives) wires[drive.bus()].push_back(&drive);
  std::vector<std::jthread> telling;
  for (const auto& [bus, drives] : wires)
    telling.emplace_back([this, &drives = drives] { tell_to_stop(drives); });
}

void ModbusGantryDevice::tell_to_stop(const std::vector<ModbusDriveDevice*>& drives) const {
  const ProfileCommand& stop = controller_->profile.stop;
  const auto told = [&] { return Until{clock_.now() + drives.front()->bus()->farewell(), {}}; };
  const auto tell = [&](ModbusDriveDevice* drive) {
    const auto writes = composed(drive->config(), stop, {});
    return !writes || drive->begin(stop, *writes, told(), Delivery::sent_only).has_value();
  };
  // All are told before the first pulse ends; whoever did not answer once more, after the others.
  std::vector<ModbusDriveDevice*> silent;
  for (ModbusDriveDevice* drive : drives)
    if (!tell(drive)) silent.push_back(drive);
  for (ModbusDriveDevice* drive : silent) (void)tell(drive);
  if (stop.trigger.style == TriggerStyle::implicit || stop.trigger.style == TriggerStyle::value)
    return;
  clock_.sleep_until(clock_.now() + stop.trigger.pulse, {});
  for (ModbusDriveDevice* drive : drives) (void)drive->end(stop, told(), Delivery::sent_only);
}

Result<GantryStatus> ModbusGantryDevice::status(const Until& until) {
  auto now = look(until);
  if (!now) return tl::unexpected(now.error());
  return std::move(now->status);
}

Result<ModbusGantryDevice::Look> ModbusGantryDevice::look(const Until& until) {
  Look look;
  GantryStatus& status = look.status;
  status.position.axes.resize(static_cast<Eigen::Index>(controller_->drives.size()));
  status.homed = true;
  status.at_rest = true;
  Eigen::Index row = 0;
  for (ModbusDriveDevice& drive : controller_->drives) {
    auto one = drive.status(until);
    if (!one) return tl::unexpected(with_context("axis " + drive.axis(), one.error()));
    status.position.axes[row++] = one->position;
    status.homed = status.homed && (one->has_homed_bit ? one->homed : homed_);
    status.at_rest = status.at_rest && !one->moving;
    look.in_position = look.in_position && one->in_position;
    if (look.not_ready.empty() && !(one->enabled && one->ready))
      look.not_ready = fmt::format("the drive of axis {} says that it is not {}", drive.axis(),
                                   one->enabled ? "ready" : "enabled");
    if (!one->alarm.empty()) status.alarm += (status.alarm.empty() ? "" : "; ") + one->alarm;
    if (one->e_stop) status.open_interlocks.push_back("emergency stop at axis " + drive.axis());
  }
  const auto open = open_interlocks(until);
  if (!open) return tl::unexpected(open.error());
  std::ranges::copy(*open, std::back_inserter(status.open_interlocks));
  if (motion_ == Motion::unknown && status.at_rest) motion_ = Motion::none;
  return look;
}

Result<std::vector<std::string>> ModbusGantryDevice::open_interlocks(const Until& until) {
  std::vector<std::string> names, open;
  std::vector<StatusBit> wanted;
  for (const Interlock& interlock : interlocks_) {
    const auto input = controller_->profile.inputs.find(interlock.input);
    if (input == controller_->profile.inputs.end()) continue;  // config has refused such a rig
    names.push_back(interlock.name);
    wanted.push_back(input->second);
  }
  if (wanted.empty()) return open;
  const auto closed = controller_->drives.front().bits(wanted, until);
  if (!closed)
    return tl::unexpected(
        with_context(fmt::format("interlock {}", fmt::join(names, ", ")), closed.error()));
  for (std::size_t i = 0; i < names.size(); ++i)
    if (!(*closed)[i]) open.push_back(names[i]);
  return open;
}

Result<void> ModbusGantryDevice::require_able_to_move(const GantryStatus& status) const {
  if (!status.alarm.empty()) return fail(ErrorCode::refused, status.alarm);
  if (!status.open_interlocks.empty())
    return fail(ErrorCode::refused, "interlock open: " + status.open_interlocks.front());
  if (!status.at_rest) return fail(ErrorCode::refused, "the gantry is moving already");
  return {};
}

Result<void> ModbusGantryDevice::wait_until_ready(const Until& until) {
  const ControllerProfile& profile = controller_->profile;
  if (!profile.ready && !profile.enabled) return {};
  const TimePoint end = std::min(clock_.now() + ready_patience, until.deadline);
  for (;;) {
    const auto now = look(until);
    if (!now) return tl::unexpected(now.error());
    if (auto able = require_able_to_move(now->status); !able) return able;
    if (now->not_ready.empty()) return {};
    if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    if (clock_.now() >= end)
      return fail(ErrorCode::refused,
                  now->not_ready +
                      ": home the gantry, which enables its drives; else look at the "
                      "drive's enable input and its power");
    clock_.sleep_until(clock_.now() + poll_interval, until.stop);
  }
}

// All axes follow one profile s(t) from 0 to 1, whose speed and acceleration are what the slowest
// axis allows: they leave and arrive together, and none exceeds its limit. An axis that is less
// than a count from its target stays: what it lacks is rounding.
std::vector<DriveMove> ModbusGantryDevice::coordinated(const GantryPosition& from,
                                                       const GantryPosition& to) const {
  double speed = std::numeric_limits<double>::infinity();
  double acceleration = std::numeric_limits<double>::infinity();
  const auto travel_of = [&](std::size_t i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double travel = std::abs(to.axes[row] - from.axes[row]);
    return travel < controller_->drives[i].resolution() ? 0.0 : travel;
  };
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const double travel = travel_of(i);
    if (travel == 0) continue;
    speed = std::min(speed, model_.axes[i].max_speed / travel);
    acceleration = std::min(acceleration, model_.axes[i].max_acceleration / travel);
  }
  std::vector<DriveMove> moves;
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const double travel = travel_of(i), target = to.axes[static_cast<Eigen::Index>(i)];
    moves.push_back({target, travel == 0 ? model_.axes[i].max_speed : speed * travel,
                     travel == 0 ? model_.axes[i].max_acceleration : acceleration * travel});
  }
  return moves;
}

Result<void> ModbusGantryDevice::start(const ProfileCommand& command,
                                       const std::vector<DriveMove>& moves, const Until& until) {
  std::vector<ModbusDriveDevice>& drives = controller_->drives;
  const auto failed = [&](std::size_t i, const Error& error) {
    return tl::unexpected(with_context("axis " + drives[i].axis(), error));
  };
  // What one drive cannot be told none is told.
  std::vector<std::vector<RegisterWrite>> writes;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    auto words = composed(drives[i].config(), command, moves[i]);
    if (!words) return failed(i, words.error());
    writes.push_back(std::move(*words));
  }
  // From the first byte on: a write that failed may still have been obeyed.
  motion_ = Motion::started;
  // All are set going before the first pulse ends, so that they arrive together too.
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (auto begun = drives[i].begin(command, writes[i], until); !begun)
      return failed(i, begun.error());
  const TriggerStyle style = command.trigger.style;
  if (style == TriggerStyle::implicit || style == TriggerStyle::value) return {};
  clock_.sleep_until(clock_.now() + command.trigger.pulse, until.stop);
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (auto ended = drives[i].end(command, until); !ended) return failed(i, ended.error());
  return {};
}

// `target` null: homing, whose end is the homed state. The previous move's done bit cannot end this
// one: moving must have been seen, or the profile's minimum delay have passed. Looks seldom while
// much of the way is left, and often about its end.
Result<void> ModbusGantryDevice::wait_for_arrival(const GantryPosition& before,
                                                  const GantryPosition* target,
                                                  const Until& until) {
  const DoneRule& rule = controller_->profile.done;
  const TimePoint begun = clock_.now(), earliest = begun + rule.minimum_delay;
  std::optional<ProgressWatch> progress;
  if (target) progress.emplace(model_, before, *target, begun, stall_patience + rule.minimum_delay);
  const double expected_s = target ? move_time(model_, before, *target) : 0;
  const auto until_next_look = [&](bool busy) -> std::chrono::nanoseconds {
    if (!busy) return poll_interval;
    const std::chrono::duration<double> left =
        std::chrono::duration<double>(expected_s) - (clock_.now() - begun);
    return std::clamp<std::chrono::nanoseconds>(
        std::chrono::duration_cast<std::chrono::nanoseconds>(left / 2), poll_interval,
        slow_poll_interval);
  };
  bool seen_busy = false;
  std::string last_seen = "the drives did not come to rest in time";
  for (;;) {
    auto seen = look(until);
    // At the deadline, where the drives were last seen says more than that there is no time left.
    if (!seen && seen.error().code == ErrorCode::timed_out && clock_.now() >= until.deadline)
      return fail(ErrorCode::timed_out, last_seen);
    if (!seen) return tl::unexpected(seen.error());
    const GantryStatus& now = seen->status;
    if (!now.alarm.empty()) return fail(ErrorCode::refused, now.alarm);
    if (!now.open_interlocks.empty())
      return fail(ErrorCode::refused, "interlock opened: " + now.open_interlocks.front());
    seen_busy = seen_busy || !now.at_rest;
    const bool believable = (rule.must_see_busy && seen_busy) || clock_.now() >= earliest;
    const bool there =
        target ? seen->in_position && arrived(model_, now.position, *target) : homed_ || now.homed;
    if (now.at_rest && believable && there) {
      motion_ = Motion::none;
      return {};
    }
    if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    last_seen = where(*seen, target);
    if (progress)
      if (auto on_the_way = progress->see(now.position, clock_.now()); !on_the_way)
        return tl::unexpected(with_context(last_seen, on_the_way.error()));
    if (clock_.now() >= until.deadline) return fail(ErrorCode::timed_out, last_seen);
    clock_.sleep_until(clock_.now() + until_next_look(!now.at_rest), until.stop);
  }
}

/// Why this is no arrival, for the message of a move that ran out of time.
std::string ModbusGantryDevice::where(const Look& seen, const GantryPosition* target) const {
  if (!seen.status.at_rest || !target) return "the drives did not come to rest in time";
  if (arrived(model_, seen.status.position, *target))
    return "the drives rest at the target but do not all say that they are in position";
  return fmt::format(
      "the drives rest {:.4g} (rad or m) from the target, tolerance {:.4g} rad or "
      "{:.4g} m",
      (seen.status.position.axes - target->axes).cwiseAbs().maxCoeff(), model_.tolerance,
      model_.linear_tolerance);
}

Result<void> ModbusGantryDevice::home(const Until& until) {
  auto before = status(until);
  if (!before) return tl::unexpected(with_context("home", before.error()));
  if (auto able = require_able_to_move(*before); !able)
    return tl::unexpected(with_context("home", able.error()));
  homed_ = false;
  const std::vector<DriveMove> none(controller_->drives.size());
  // A drive that restarted has forgotten its watchdog.
  for (ModbusDriveDevice& drive : controller_->drives)
    if (auto ready = drive.prepare(until); !ready)
      return tl::unexpected(with_context("home, axis " + drive.axis(), ready.error()));
  if (controller_->profile.enable)
    for (ModbusDriveDevice& drive : controller_->drives)
      if (auto on = drive.run(*controller_->profile.enable, until); !on)
        return tl::unexpected(with_context("enable axis " + drive.axis(), on.error()));
  if (auto ready = wait_until_ready(until); !ready)
    return tl::unexpected(with_context("home", ready.error()));
  // Without a homed bit the end of motion is all there is to see; the profile's done rule then
  // guards it.
  homed_ = !controller_->profile.homed;
  Result<void> done = start(controller_->profile.home, none, until);
  if (done) done = wait_for_arrival(before->position, nullptr, until);
  if (!done) {
    homed_ = false;
    tell_to_stop();
    return tl::unexpected(with_context("home", done.error()));
  }
  homed_ = true;
  return {};
}

Result<void> ModbusGantryDevice::move_to(const GantryPosition& position, const Until& until) {
  if (!within_limits(model_, position))
    return fail(ErrorCode::refused, "the target lies outside the gantry's travel; nothing moved");
  auto before = look(until);
  if (!before)
    return tl::unexpected(with_context("read the position before the move", before.error()));
  if (auto able = require_able_to_move(before->status); !able) return able;
  if (!before->status.homed) return fail(ErrorCode::refused, "not homed: home first");
  if (!before->not_ready.empty())
    if (auto ready = wait_until_ready(until); !ready) return ready;
  const auto moves = coordinated(before->status.position, position);
  Result<void> done = start(controller_->profile.move, moves, until);
  if (done) done = wait_for_arrival(before->status.position, &position, until);
  if (!done) {
    tell_to_stop();
    // A drive that refuses a command does not say why; its status does.
    if (done.error().code == ErrorCode::refused || done.error().code == ErrorCode::timed_out)
      if (const auto now = status(until); now)
        if (auto able = require_able_to_move(*now);
            !able && (!now->alarm.empty() || !now->open_interlocks.empty()))
          done = able;
    return tl::unexpected(with_context("move", done.error()));
  }
  return {};
}

Result<void> ModbusGantryDevice::clear_fault(const Until& until) {
  if (!controller_->profile.reset_alarm) return {};
  for (ModbusDriveDevice& drive : controller_->drives)
    if (auto done = drive.run(*controller_->profile.reset_alarm, until); !done)
      return tl::unexpected(with_context("reset the alarm of axis " + drive.axis(), done.error()));
  return {};
}

}  // namespace lightrig
