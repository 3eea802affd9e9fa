#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/result.h"
#include "sim/wire_faults.h"

namespace lightrig::sim {

class CameraWireFaults;
class World;

/// The far end of one wire, running on threads of its own until it is destroyed.
struct HostedWire {
  std::string part;     ///< "gantry", "lamp" or "camera"
  std::string address;  ///< where a driver finds it: "127.0.0.1:1502", "/dev/pts/7", "127.0.0.1"
  std::shared_ptr<void> server;
  /// What a program must find in its environment to see it; usually nothing.
  std::map<std::string, std::string> environment;
  /// What the far end has seen of its own affairs, a line each; empty where it keeps no story.
  std::function<std::string()> story;
};

// One overload per backend; in builds without the backend the twin answers not_built. `faults` may
// be null. Errors: refused (address in use).
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const ModbusGantry& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults = {});
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const ModbusLamp& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults = {});
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const GrblGantry& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults = {});
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const GrblLamp& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults = {});
/// A camera at the address that the rig file names, which must be this machine's own; a rig file
/// that names it by serial number has it discovered on interface_ip, or on loopback.
Result<std::vector<HostedWire>> host_wire(const Rig& rig, const AravisCamera& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<CameraWireFaults> faults = {});

}  // namespace lightrig::sim
