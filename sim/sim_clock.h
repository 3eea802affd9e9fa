#pragma once

#include <memory>

#include "drivers/clock.h"

namespace lightrig::sim {

/// A clock on which waiting passes `rate` times faster than really, while computing takes the time
/// it takes; rate = infinity jumps to the time slept for (one sleeping thread).
std::unique_ptr<Clock> make_clock(double rate);

}  // namespace lightrig::sim
