#pragma once

#include <cstdint>
#include <memory>

#include "config/rig.h"
#include "core/brdf_table.h"
#include "drivers/devices.h"

namespace lightrig::sim {

class World;

/// The truth of a simulated rig: what a perfect measurement would give. Errors: not_found for an
/// unknown material.
Result<Reflectance> truth_of(const Rig& rig);

/// The simulated laboratory behind a rig: object, gantry dynamics, lamp, camera. One world per
/// opened rig; the devices share it. The object is the session's, so it is made when the session is
/// known.
Result<std::shared_ptr<World>> make_world(const Rig& rig, const ObjectConfig& object, Clock& clock,
                                          std::uint64_t seed);

/// The same rig in memory. Whole or not at all. (World is shared by the three devices and the
/// caller: the one place where shared ownership is the truth.)
Result<Devices> open_devices(const Rig& rig, std::shared_ptr<World> world);

}  // namespace lightrig::sim
