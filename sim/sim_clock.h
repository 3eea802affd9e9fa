#pragma once

#include <memory>

#include "drivers/clock.h"

namespace lightrig::sim {

/// A clock that runs `rate` times faster than real; rate = infinity jumps to the time slept for
/// (one sleeping thread).
std::unique_ptr<Clock> make_clock(double rate);

}  // namespace lightrig::sim
