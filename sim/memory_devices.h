#pragma once

#include <memory>

#include "drivers/devices.h"
#include "sim/world.h"

namespace lightrig::sim {

// The three devices of a world in memory: they wait on the world's clock, obey deadline and stop,
// and refuse what hardware would refuse.

std::unique_ptr<Gantry> make_gantry(std::shared_ptr<World> world);
std::unique_ptr<Lamp> make_lamp(std::shared_ptr<World> world);
std::unique_ptr<Camera> make_camera(std::shared_ptr<World> world);

}  // namespace lightrig::sim
