// Opening a gantry of Modbus drives: one wire for all that is on it, the drives' watchdogs, and the
// lamp that shares the wire.
#include <fmt/format.h>

#include <algorithm>

#include "drivers/backends.h"
#include "drivers/lamp_power.h"
#include "drivers/modbus/modbus_gantry.h"
#include "drivers/modbus/modbus_lamp.h"

namespace lightrig {
namespace {

/// The lamp on a digital output of the gantry's controller (its first drive).
class OutputLamp final : public Lamp {
 public:
  OutputLamp(ProfileOutput output, double most, Clock& clock,
             std::shared_ptr<ModbusController> controller)
      : output_(output), most_(most), clock_(clock), controller_(std::move(controller)) {}
  ~OutputLamp() override {
    (void)set(0, {clock_.now() + controller_->drives.front().bus()->farewell(), {}});
  }
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
    places[wire_of(drive.endpoint)].push_back(
        {drive.unit, item.table, item.address, item.registers()});
  for (auto& [wire, units] : places)
    controller.buses.at(wire)->keep_alive(std::move(units),
                                          controller.profile.watchdog->timeout / 3);
}

// After a lost answer a serial line is silent for three timeouts more, and the watchdog is fed at a
// third of its time: one that barks earlier would turn every lost answer into an alarm.
Result<void> watchdog_outlasts_recovery(const ModbusGantry& backend) {
  const auto& watchdog = backend.controller.watchdog;
  const bool serial =
      std::any_of(backend.drives.begin(), backend.drives.end(), [](const ModbusDrive& drive) {
        return std::holds_alternative<SerialEndpoint>(drive.endpoint);
      });
  if (!watchdog || !serial || 6 * backend.timeout < watchdog->timeout) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("[gantry.modbus] timeout_ms = {} leaves no time to recover from a lost "
                          "answer before the drives' watchdog of {} ms barks: on a serial line it "
                          "must be below a sixth of that",
                          backend.timeout.count(), watchdog->timeout.count()));
}

/// Where a drive keeps the gantry from being opened, a lamp that an earlier program left burning
/// still goes dark, if the wire to it is there.
void darken(const Rig& rig, ModbusController& controller, Clock& clock) {
  if (const auto* unit = std::get_if<ModbusLamp>(&rig.lamp.backend)) {
    const auto bus = controller.buses.find(wire_of(unit->endpoint));
    if (bus != controller.buses.end() && bus->second)  // that it is opened is that it goes dark
      (void)make_modbus_lamp(
          rig, *unit, clock,
          std::shared_ptr<ModbusBus>(std::shared_ptr<void>(), bus->second.get()));
  }
  const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend);
  if (lamp == nullptr || controller.drives.empty()) return;
  const auto output = controller.profile.outputs.find(lamp->output);
  if (output == controller.profile.outputs.end()) return;
  ModbusDriveDevice& first = controller.drives.front();
  (void)first.set_output(output->second, 0, {clock.now() + first.bus()->farewell(), {}});
}

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig& rig, const ModbusGantry& backend, Clock& clock) {
  if (auto sound = watchdog_outlasts_recovery(backend); !sound)
    return tl::unexpected(sound.error());
  for (const ModbusDrive& drive : backend.drives)
    for (const Axis& axis : rig.gantry.model.axes)
      if (axis.name == drive.axis)
        if (auto held = can_hold_limits(drive, backend.controller.move, axis.max_speed,
                                        axis.max_acceleration);
            !held)
          return tl::unexpected(held.error());
  auto controller = std::make_shared<ModbusController>();
  controller->profile = backend.controller;
  GantryAndLamp opened;
  // First of all: where a later step fails, its end still stops the drives that were reached.
  opened.gantry = std::make_unique<ModbusGantryDevice>(rig, clock, controller);
  for (const ModbusDrive& drive : backend.drives) {
    auto& bus = controller->buses[wire_of(drive.endpoint)];
    if (!bus) {
      auto connected =
          ModbusBus::open(drive.endpoint, backend.timeout, controller->profile.frame_gap, clock);
      if (!connected) {
        darken(rig, *controller, clock);
        return tl::unexpected(connected.error());
      }
      bus = std::move(*connected);
    }
    ModbusDriveDevice device(controller->profile, drive, *bus, clock);
    const Until until{clock.now() + 6 * backend.timeout, {}};
    if (auto ready = device.prepare(until); !ready) {
      darken(rig, *controller, clock);
      return tl::unexpected(with_context("axis " + drive.axis, ready.error()));
    }
    controller->drives.push_back(std::move(device));  // proved: what is not is never written to
  }
  feed_watchdogs(backend, *controller);
  if (const auto* unit = std::get_if<ModbusLamp>(&rig.lamp.backend)) {
    // A lamp unit on the gantry's own wire: a serial line has one master.
    const auto bus = controller->buses.find(wire_of(unit->endpoint));
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
