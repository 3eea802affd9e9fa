#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "config/rig.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session.h"
#include "drivers/clock.h"
#include "sim/faults.h"
#include "sim/world.h"

namespace lightrig {

/// A small rig as a person would write it, and a session on it: 48 × 36 pixels of a sphere under
/// three planned lights and one held out. `change` replaces one text of the rig file by another.
struct RigChange {
  std::string from, to;
};
Rig small_rig(const std::filesystem::path& folder, const std::vector<RigChange>& changes = {});
SessionSpec spec_of(const Rig& rig);

/// The plan of small_rig() without changes, computed once a process.
const Prepared& small_plan();

/// The laboratory of a rig on a clock that jumps, with its devices and the faults they are to have.
struct Laboratory {
  explicit Laboratory(const Rig& rig, std::vector<sim::Fault> faults = {});
  ReopenDevices reopen();

  Rig rig;
  std::unique_ptr<Clock> clock;
  std::shared_ptr<sim::World> world;
  std::shared_ptr<sim::FaultScript> script;
  Devices devices;
  std::vector<Reopen> asked_to_reopen;
};

/// One call of capture() in a laboratory of its own, as after a restart of the process.
SessionEnd capture_in(const SessionFolder& folder, Laboratory& laboratory, SessionControl& control,
                      const SessionListeners& listeners = {});

/// The bytes of everything that a resumed session must have in common with an uninterrupted one:
/// each frame by name, and each shot's journal entry without its measured part, in order.
std::string comparable_text(const SessionFolder& folder);

}  // namespace lightrig
