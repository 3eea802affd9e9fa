#pragma once

#include <memory>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/result.h"

namespace lightrig::sim {

class CameraWireFaults;
class World;

/// The far end of one wire, running on threads of its own until it is destroyed.
struct HostedWire {
  std::string part;     ///< "gantry", "lamp" or "camera"
  std::string address;  ///< where a driver finds it: "127.0.0.1:1502", "/dev/pts/7", "127.0.0.1"
  std::shared_ptr<void> server;
};

// One overload per backend; in builds without the backend the twin answers not_built. Errors:
// refused (address in use).
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const ModbusGantry& backend,
                                          std::shared_ptr<World> world);
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const GrblGantry& backend,
                                          std::shared_ptr<World> world);
/// A camera at the address that the rig file names, which must be this machine's own; a rig file
/// that names it by serial number has it discovered on interface_ip, or on loopback. `faults` may
/// be null.
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const AravisCamera& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<CameraWireFaults> faults = nullptr);

}  // namespace lightrig::sim
