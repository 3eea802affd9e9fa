#pragma once

#include <chrono>
#include <vector>

#include "sim/modbus/modbus_pdu.h"
#include "sim/wire_faults.h"

namespace lightrig::sim {

/// Bytes to send, and how long after the request.
struct LateBytes {
  std::chrono::milliseconds delay{0};
  Bytes bytes;
};

/// What a fault makes of a whole answer, framing included; nothing where it is lost.
std::vector<LateBytes> spoiled(const Bytes& answer, const WireFault& fault, bool tcp);

}  // namespace lightrig::sim
