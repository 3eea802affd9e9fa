#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/modbus/modbus_unit.h"

namespace lightrig::sim {

using Bytes = std::vector<std::uint8_t>;

/// The answer of a unit to one request, both without framing (function code and what follows)
/// [Modbus Application Protocol 1.1b3]: functions 01–06, 0F, 10; anything else is exception 1.
Bytes answer_pdu(ModbusUnit& unit, std::span<const std::uint8_t> request);

/// CRC-16/MODBUS, low byte first on the wire.
std::uint16_t crc16(std::span<const std::uint8_t> bytes);

/// Length of the RTU request that begins with these bytes, address and CRC included; nullopt until
/// it can be told, 0 when it is no request.
std::optional<std::size_t> rtu_request_length(std::span<const std::uint8_t> begun);

}  // namespace lightrig::sim
