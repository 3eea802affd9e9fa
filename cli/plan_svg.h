#pragma once

#include <string>

#include "daemon/session/prepare.h"

namespace lightrig::cli {

/// The plan as a picture (SVG): every candidate and the camera seen from above, the chosen lights
/// in order with the way between them, and what each light adds (predicted error, κ², new cells).
std::string plan_svg(const Rig& rig, const Prepared& prepared);

}  // namespace lightrig::cli
