#pragma once

#include <string>
#include <vector>

#include "sim/aravis/camera_registers.h"

namespace lightrig::sim {

/// The camera's GenICam description [GenApi 1.0, SFNC 2]: which features there are, their limits,
/// and the registers behind them.
std::string camera_xml(const CameraBody& body);

/// The formats a camera with this sensor offers: its own filter's.
std::vector<const PixelFormat*> offered_formats(ColorFilter filter);

}  // namespace lightrig::sim
