#pragma once

#include "drivers/devices.h"

namespace lightrig::cli {

/// The operator panel as `lightrig backends` tells of it: lightrigd of the same build serves it, or
/// leaves it out.
Backend panel_backend();

}  // namespace lightrig::cli
