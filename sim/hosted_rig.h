#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "config/rig.h"
#include "core/result.h"
#include "drivers/clock.h"
#include "sim/camera_wire_faults.h"
#include "sim/hosted_wire.h"
#include "sim/wire_faults.h"

namespace lightrig::sim {

/// A whole rig at the far end of its wires: one clock, one laboratory, a front end per wire.
/// Destroying it closes the wires first.
struct HostedRig {
  std::unique_ptr<Clock> clock;
  std::shared_ptr<World> world;
  std::shared_ptr<WireFaults> faults;
  std::shared_ptr<CameraWireFaults> camera_faults;
  std::vector<HostedWire> wires;

  /// Takes a fault as text [docs/simulate.md]: of the gantry's and lamp's wires as
  /// parse_wire_fault() has it, of the camera's "KIND [frame=N] [seconds=S]" or "loss share=S
  /// [resend=yes|no] [seed=N]". Errors:
  /// invalid_input, with what would be right.
  Result<void> add_fault(std::string_view line);
  /// A script: one fault a line, empty lines and # comments left out. Errors name the line.
  Result<void> add_faults(const std::string& text, const std::string& file);
  /// What has struck so far on any wire, in order by wire.
  std::vector<std::string> struck() const;

  /// What a program needs in its environment to find them all.
  std::map<std::string, std::string> environment() const;
};

/// Hosts every wire that the rig names, in real time, with this object before the camera. Errors:
/// invalid_input (no [simulation]), refused (the rig names no hardware at all, an address is in
/// use), not_built.
Result<HostedRig> host_rig(const Rig& rig, const ObjectConfig& object, std::uint64_t seed);

}  // namespace lightrig::sim
