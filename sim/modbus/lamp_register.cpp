#include "sim/modbus/lamp_register.h"

#include <cmath>

namespace lightrig::sim {

bool LampRegister::is_mine(RegisterTable table, int address) const {
  if (config_.coil) return table == RegisterTable::coil && address == *config_.coil;
  return table == RegisterTable::holding && config_.holding && address == *config_.holding;
}

// What the lamp does, not what was written: a lease that ran out reads 0.
std::optional<std::uint16_t> LampRegister::read(RegisterTable table, int address) const {
  if (!is_mine(table, address)) return std::nullopt;
  return static_cast<std::uint16_t>(std::lround(world_->lamp_power() * full()));
}

std::optional<ModbusException> LampRegister::write(RegisterTable table, int address,
                                                   std::uint16_t value) {
  if (!is_mine(table, address)) return ModbusException::illegal_address;
  // A coil is on or off: on is all that the rig allows.
  const double power =
      config_.coil ? (value != 0 ? world_->rig().lamp.max_power : 0.0) : value / full();
  if (!world_->set_lamp(power)) return ModbusException::illegal_value;
  return std::nullopt;
}

}  // namespace lightrig::sim
