// A gantry of Modbus drives: coordinated moves, arrival that cannot be fooled, outputs and inputs
// of its controller.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "drivers/backends.h"
#include "drivers/lamp_power.h"
#include "drivers/modbus/modbus_drive.h"
#include "drivers/modbus/modbus_lamp.h"

namespace lightrig {
namespace {

constexpr std::chrono::milliseconds poll_interval{20};
constexpr std::chrono::milliseconds farewell{1000};

std::string wire_key(const ModbusBus::Endpoint& endpoint) {
  if (const auto* tcp = std::get_if<TcpEndpoint>(&endpoint))
    return fmt::format("{}:{}", tcp->host, tcp->port);
  return std::get<SerialEndpoint>(endpoint).device;
}

/// The wires and drives, shared by the gantry and the lamp on its outputs, both used by the session
/// thread alone.
struct ModbusController {
  ControllerProfile profile;
  std::map<std::string, std::unique_ptr<ModbusBus>>
      buses;                              // one per wire, however many drives are on it
  std::vector<ModbusDriveDevice> drives;  // in axis order
};

class ModbusGantryDevice final : public Gantry {
 public:
  ModbusGantryDevice(const Rig& rig, Clock& clock, std::shared_ptr<ModbusController> controller)
      : model_(rig.gantry.model),
        interlocks_(rig.interlocks),
        clock_(clock),
        controller_(std::move(controller)) {}
  ~ModbusGantryDevice() override { tell_to_stop(); }

  Result<void> home(const Until& until) override;
  Result<void> move_to(const GantryPosition& position, const Until& until) override;
  Result<GantryStatus> status(const Until& until) override;
  Result<void> clear_fault(const Until& until) override;

 private:
  Result<std::vector<DriveMove>> coordinated(const GantryPosition& from,
                                             const GantryPosition& to) const;
  Result<void> start(const ProfileCommand& command, const std::vector<DriveMove>& moves,
                     const Until& until);
  Result<void> wait_for_arrival(const GantryPosition* target, const Until& until);
  Result<void> require_able_to_move(const GantryStatus& status) const;
  void tell_to_stop();

  const GantryModel model_;
  const std::vector<Interlock> interlocks_;
  Clock& clock_;
  std::shared_ptr<ModbusController> controller_;
  bool homed_ = false;   ///< for drives whose profile has no homed bit
  bool moving_ = false;  ///< a motion was started and its end not yet seen
};

void ModbusGantryDevice::tell_to_stop() {
  if (!moving_) return;
  // The stop is sent to every drive, whatever becomes of the others: with a deadline of its own,
  // after any stop request. All drives are told before the first pulse ends.
  const ProfileCommand& stop = controller_->profile.stop;
  const auto told = [&] { return Until{clock_.now() + farewell, {}}; };
  for (ModbusDriveDevice& drive : controller_->drives) (void)drive.begin(stop, {}, told());
  if (stop.trigger.style == TriggerStyle::implicit || stop.trigger.style == TriggerStyle::value)
    return;
  clock_.sleep_until(clock_.now() + stop.trigger.pulse, {});
  for (ModbusDriveDevice& drive : controller_->drives) (void)drive.end(stop, told());
}

Result<GantryStatus> ModbusGantryDevice::status(const Until& until) {
  GantryStatus status;
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
    if (!one->alarm.empty()) status.alarm += (status.alarm.empty() ? "" : "; ") + one->alarm;
    if (one->e_stop) status.open_interlocks.push_back("emergency stop at axis " + drive.axis());
  }
  for (const Interlock& interlock : interlocks_) {
    const auto input = controller_->profile.inputs.find(interlock.input);
    if (input == controller_->profile.inputs.end()) continue;  // config has refused such a rig
    auto closed = controller_->drives.front().bit(input->second, until);
    if (!closed) return tl::unexpected(with_context("interlock " + interlock.name, closed.error()));
    if (!*closed) status.open_interlocks.push_back(interlock.name);
  }
  return status;
}

Result<void> ModbusGantryDevice::require_able_to_move(const GantryStatus& status) const {
  if (!status.alarm.empty()) return fail(ErrorCode::refused, status.alarm);
  if (!status.open_interlocks.empty())
    return fail(ErrorCode::refused, "interlock open: " + status.open_interlocks.front());
  if (!status.at_rest) return fail(ErrorCode::refused, "the gantry is moving already");
  return {};
}

// All axes follow one profile s(t) from 0 to 1, whose speed and acceleration are what the slowest
// axis allows: they leave and arrive together, and none exceeds its limit.
Result<std::vector<DriveMove>> ModbusGantryDevice::coordinated(const GantryPosition& from,
                                                               const GantryPosition& to) const {
  double speed = std::numeric_limits<double>::infinity();
  double acceleration = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double travel = std::abs(to.axes[row] - from.axes[row]);
    if (travel < 1e-12) continue;
    speed = std::min(speed, model_.axes[i].max_speed / travel);
    acceleration = std::min(acceleration, model_.axes[i].max_acceleration / travel);
  }
  std::vector<DriveMove> moves;
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double travel = std::abs(to.axes[row] - from.axes[row]);
    const bool still = travel < 1e-12;
    moves.push_back({to.axes[row], still ? model_.axes[i].max_speed : speed * travel,
                     still ? model_.axes[i].max_acceleration : acceleration * travel});
  }
  return moves;
}

Result<void> ModbusGantryDevice::start(const ProfileCommand& command,
                                       const std::vector<DriveMove>& moves, const Until& until) {
  moving_ = true;  // from the first byte on: a write that failed may still have been obeyed
  std::vector<ModbusDriveDevice>& drives = controller_->drives;
  const auto failed = [&](std::size_t i, const Error& error) {
    return tl::unexpected(with_context("axis " + drives[i].axis(), error));
  };
  // All are set going before the first pulse ends, so that they arrive together too.
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (auto begun = drives[i].begin(command, moves[i], until); !begun)
      return failed(i, begun.error());
  const TriggerStyle style = command.trigger.style;
  if (style == TriggerStyle::implicit || style == TriggerStyle::value) return {};
  clock_.sleep_until(clock_.now() + command.trigger.pulse, until.stop);
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (auto ended = drives[i].end(command, until); !ended) return failed(i, ended.error());
  return {};
}

// `target` null: homing, whose end is the homed state. The previous move's done bit cannot end this
// one: moving must have been seen, or the profile's minimum delay have passed.
Result<void> ModbusGantryDevice::wait_for_arrival(const GantryPosition* target,
                                                  const Until& until) {
  const DoneRule& rule = controller_->profile.done;
  const TimePoint earliest = clock_.now() + rule.minimum_delay;
  bool seen_busy = false;
  std::string last_seen = "the drives did not come to rest in time";
  for (;;) {
    auto now = status(until);
    // At the deadline, where the drives were last seen says more than that there is no time left.
    if (!now && now.error().code == ErrorCode::timed_out && clock_.now() >= until.deadline)
      return fail(ErrorCode::timed_out, last_seen);
    if (!now) return tl::unexpected(now.error());
    if (!now->alarm.empty()) return fail(ErrorCode::refused, now->alarm);
    if (!now->open_interlocks.empty())
      return fail(ErrorCode::refused, "interlock opened: " + now->open_interlocks.front());
    seen_busy = seen_busy || !now->at_rest;
    const bool believable = (rule.must_see_busy && seen_busy) || clock_.now() >= earliest;
    const bool there = target ? arrived(model_, now->position, *target) : homed_ || now->homed;
    if (now->at_rest && believable && there) {
      moving_ = false;
      return {};
    }
    if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    last_seen = now->at_rest && target
                    ? fmt::format(
                          "the drives rest {:.4g} (rad or m) from the target, tolerance {:.4g} "
                          "rad or {:.4g} m",
                          (now->position.axes - target->axes).cwiseAbs().maxCoeff(),
                          model_.tolerance, model_.linear_tolerance)
                    : std::string("the drives did not come to rest in time");
    if (clock_.now() >= until.deadline) return fail(ErrorCode::timed_out, last_seen);
    clock_.sleep_until(clock_.now() + poll_interval, until.stop);
  }
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
      if (auto on = drive.run(*controller_->profile.enable, {}, until); !on)
        return tl::unexpected(with_context("enable axis " + drive.axis(), on.error()));
  // Without a homed bit the end of motion is all there is to see; the profile's done rule then
  // guards it.
  homed_ = !controller_->profile.homed;
  Result<void> done = start(controller_->profile.home, none, until);
  if (done) done = wait_for_arrival(nullptr, until);
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
  auto before = status(until);
  if (!before)
    return tl::unexpected(with_context("read the position before the move", before.error()));
  if (auto able = require_able_to_move(*before); !able) return able;
  if (!before->homed) return fail(ErrorCode::refused, "not homed: home first");
  auto moves = coordinated(before->position, position);
  if (!moves) return tl::unexpected(moves.error());
  Result<void> done = start(controller_->profile.move, *moves, until);
  if (done) done = wait_for_arrival(&position, until);
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
    if (auto done = drive.run(*controller_->profile.reset_alarm, {}, until); !done)
      return tl::unexpected(with_context("reset the alarm of axis " + drive.axis(), done.error()));
  return {};
}

/// The lamp on a digital output of the gantry's controller (its first drive).
class OutputLamp final : public Lamp {
 public:
  OutputLamp(ProfileOutput output, double most, Clock& clock,
             std::shared_ptr<ModbusController> controller)
      : output_(output), most_(most), clock_(clock), controller_(std::move(controller)) {}
  ~OutputLamp() override { (void)set(0, {clock_.now() + farewell, {}}); }
  Result<void> set(double power, const Until& until) override {
    if (auto allowed = allowed_power(power, most_); !allowed) return allowed;
    auto done = controller_->drives.front().set_output(output_, power, until);
    if (!done) return tl::unexpected(with_context("switch the lamp", done.error()));
    return {};
  }
  Result<LampState> state(const Until& until) override {
    auto power = controller_->drives.front().read_output(output_, until);
    if (!power) return tl::unexpected(with_context("read the lamp", power.error()));
    return LampState{*power, true, std::nullopt};
  }

 private:
  const ProfileOutput output_;
  const double most_;
  Clock& clock_;
  std::shared_ptr<ModbusController> controller_;
};

// A drive's watchdog is fed at a third of its time.
void feed_watchdogs(const ModbusGantry& backend, ModbusController& controller) {
  if (!controller.profile.watchdog) return;
  const RegisterItem& item = controller.profile.watchdog->item;
  std::map<std::string, std::vector<ModbusBus::Place>> places;
  for (const ModbusDrive& drive : backend.drives)
    places[wire_key(drive.endpoint)].push_back(
        {drive.unit, item.table, item.address, item.registers()});
  for (auto& [wire, units] : places)
    controller.buses.at(wire)->keep_alive(std::move(units),
                                          controller.profile.watchdog->timeout / 3);
}

// After a lost answer a serial line is silent for three timeouts more: a watchdog that barks
// earlier would turn every lost answer into an alarm.
Result<void> watchdog_outlasts_recovery(const ModbusGantry& backend) {
  const auto& watchdog = backend.controller.watchdog;
  const bool serial =
      std::any_of(backend.drives.begin(), backend.drives.end(), [](const ModbusDrive& drive) {
        return std::holds_alternative<SerialEndpoint>(drive.endpoint);
      });
  if (!watchdog || !serial || 4 * backend.timeout < watchdog->timeout) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("[gantry.modbus] timeout_ms = {} leaves no time to recover from a lost "
                          "answer before the drives' watchdog of {} ms barks: on a serial line it "
                          "must be below a quarter of that",
                          backend.timeout.count(), watchdog->timeout.count()));
}

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig& rig, const ModbusGantry& backend, Clock& clock) {
  if (auto sound = watchdog_outlasts_recovery(backend); !sound)
    return tl::unexpected(sound.error());
  auto controller = std::make_shared<ModbusController>();
  controller->profile = backend.controller;
  for (const ModbusDrive& drive : backend.drives) {
    auto& bus = controller->buses[wire_key(drive.endpoint)];
    if (!bus) {
      auto opened = ModbusBus::open(drive.endpoint, backend.timeout, clock);
      if (!opened) return tl::unexpected(opened.error());
      bus = std::move(*opened);
    }
    controller->drives.emplace_back(controller->profile, drive, *bus, clock);
    const Until until{clock.now() + 6 * backend.timeout, {}};
    if (auto ready = controller->drives.back().prepare(until); !ready)
      return tl::unexpected(with_context("axis " + drive.axis, ready.error()));
  }
  feed_watchdogs(backend, *controller);
  GantryAndLamp opened;
  opened.gantry = std::make_unique<ModbusGantryDevice>(rig, clock, controller);
  if (const auto* unit = std::get_if<ModbusLamp>(&rig.lamp.backend)) {
    // A lamp unit on the gantry's own wire: a serial line has one master.
    const auto bus = controller->buses.find(wire_key(unit->endpoint));
    if (bus == controller->buses.end()) return opened;
    auto shared = std::shared_ptr<ModbusBus>(controller, bus->second.get());
    auto lamp = make_modbus_lamp(rig, *unit, clock, std::move(shared));
    if (!lamp) return tl::unexpected(lamp.error());
    opened.lamp = std::move(*lamp);
  }
  const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend);
  if (!lamp) return opened;
  const auto output = controller->profile.outputs.find(lamp->output);
  if (output == controller->profile.outputs.end())
    return fail(ErrorCode::invalid_input,
                fmt::format("the controller profile {} has no output \"{}\" for the lamp",
                            controller->profile.name, lamp->output));
  opened.lamp = std::make_unique<OutputLamp>(output->second, rig.lamp.max_power, clock, controller);
  return opened;
}

Backend modbus_backend() { return {"modbus", true, ""}; }

}  // namespace lightrig
