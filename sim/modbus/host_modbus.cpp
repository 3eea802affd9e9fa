// The far ends of a rig's Modbus wires.
#include <set>

#include "drivers/backends.h"
#include "sim/hosted_wire.h"
#include "sim/modbus/drive_registers.h"
#include "sim/modbus/lamp_register.h"
#include "sim/modbus/modbus_server.h"

namespace lightrig::sim {
namespace {

using Endpoint = ModbusServer::Endpoint;

bool same_wire(const Endpoint& a, const Endpoint& b) { return wire_of(a) == wire_of(b); }

Result<HostedWire> host(const char* part, const Endpoint& endpoint, ModbusServer::Units units,
                        std::shared_ptr<WireFaults> faults, Wire wire) {
  auto server = ModbusServer::open(endpoint, std::move(units), std::move(faults), wire);
  if (!server)
    return tl::unexpected(with_context(std::string("simulate the ") + part, server.error()));
  std::shared_ptr<ModbusServer> shared = std::move(*server);
  return HostedWire{part, shared->address(), shared, {}, {}};
}

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig& rig, const ModbusGantry& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults) {
  std::vector<HostedWire> hosted;
  std::vector<bool> done(backend.drives.size(), false);
  const auto* lamp = std::get_if<ModbusLamp>(&rig.lamp.backend);
  for (std::size_t i = 0; i < backend.drives.size(); ++i) {
    if (done[i]) continue;
    // All that is on the same wire are units of one server: drives, and a lamp of its own unit.
    const Endpoint& endpoint = backend.drives[i].endpoint;
    ModbusServer::Units units;
    for (std::size_t j = i; j < backend.drives.size(); ++j) {
      if (!same_wire(endpoint, backend.drives[j].endpoint)) continue;
      units[backend.drives[j].unit] = std::make_unique<DriveRegisters>(backend, j, world);
      done[j] = true;
    }
    if (lamp && same_wire(endpoint, lamp->endpoint))
      units.try_emplace(lamp->unit, std::make_unique<LampRegister>(*lamp, world));
    auto wire = host("gantry", endpoint, std::move(units), faults, Wire::gantry);
    if (!wire) return tl::unexpected(wire.error());
    hosted.push_back(std::move(*wire));
  }
  return hosted;
}

Result<std::vector<HostedWire>> host_wire(const Rig& rig, const ModbusLamp& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults) {
  // On the gantry's own wire it is hosted with the drives.
  if (const auto* gantry = std::get_if<ModbusGantry>(&rig.gantry.backend))
    for (const ModbusDrive& drive : gantry->drives)
      if (same_wire(drive.endpoint, backend.endpoint)) return std::vector<HostedWire>{};
  ModbusServer::Units units;
  if (std::holds_alternative<FixedLampsGantry>(rig.gantry.backend)) {
    units[backend.unit] = std::make_unique<LampBankRegisters>(backend, std::move(world));
  } else {
    units[backend.unit] = std::make_unique<LampRegister>(backend, std::move(world));
  }
  auto wire = host("lamp", backend.endpoint, std::move(units), std::move(faults), Wire::lamp);
  if (!wire) return tl::unexpected(wire.error());
  return std::vector<HostedWire>{std::move(*wire)};
}

}  // namespace lightrig::sim
