#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "config/controller_profile.h"

namespace lightrig::sim {

/// Why a request is answered by an exception [Modbus Application Protocol 1.1b3, 7].
enum class ModbusException : std::uint8_t {
  illegal_address = 2,
  illegal_value = 3,
  device_failure = 4
};

/// One unit of a Modbus wire: registers, and what they do. No wire, no thread.
class ModbusUnit {
 public:
  virtual ~ModbusUnit() = default;
  /// Empty where there is no such register.
  virtual std::optional<std::uint16_t> read(RegisterTable table, int address) const = 0;
  /// Obeys a write, and whatever it triggers.
  virtual std::optional<ModbusException> write(RegisterTable table, int address,
                                               std::uint16_t value) = 0;
  /// A request has arrived for this unit.
  virtual void heard() = 0;
  /// Time passes.
  virtual void tick() = 0;
  /// Silence that it wants between its answer and the next request: it hears nothing earlier.
  virtual std::chrono::milliseconds gap() const { return {}; }
  /// Power fails and comes back: everything volatile is as it was at the factory.
  virtual void reboot() = 0;
};

}  // namespace lightrig::sim
