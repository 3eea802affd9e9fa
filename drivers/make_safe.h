#pragma once

#include "config/rig.h"
#include "core/result.h"
#include "drivers/clock.h"

namespace lightrig {

/// Lamp dark and motion stopped, as far as each can be reached: on wires of their own neither waits
/// for the other's, on one wire the gantry's driver opens both. The camera is not asked. What a rig
/// needs after the program that drove it has died. Errors: what could not be done; says LAMP MAY BE
/// ON where the lamp was not seen to be dark.
Result<void> make_safe(const Rig& rig, Clock& clock);

}  // namespace lightrig
