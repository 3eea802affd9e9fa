#include "sim/modbus/lamp_register.h"

#include <algorithm>
#include <cmath>

namespace lightrig::sim {

bool LampRegister::is_mine(RegisterTable table, int address) const {
  if (config_.coil) return table == RegisterTable::coil && address == *config_.coil;
  return table == RegisterTable::holding && config_.holding && address == *config_.holding;
}

// What the lamp does, not what was written: one that failed reads 0.
std::optional<std::uint16_t> LampRegister::read(RegisterTable table, int address) const {
  if (config_.temperature && table == RegisterTable::holding && address == *config_.temperature) {
    const double counts = world_->lamp_temperature() / config_.degrees_per_count;
    return static_cast<std::uint16_t>(static_cast<std::int16_t>(std::lround(counts)));
  }
  if (!is_mine(table, address)) return std::nullopt;
  return static_cast<std::uint16_t>(std::lround(world_->lamp_power() * full()));
}

std::optional<ModbusException> LampRegister::write(RegisterTable table, int address,
                                                   std::uint16_t value) {
  if (!is_mine(table, address)) return ModbusException::illegal_address;
  // A coil is on or off, and on is all that the lamp gives, whatever the rig allows.
  const double power = config_.coil ? (value != 0 ? 1.0 : 0.0) : value / full();
  if (!world_->switch_lamp(power)) return ModbusException::illegal_value;
  return std::nullopt;
}

LampBankRegisters::LampBankRegisters(const ModbusLamp& config, std::shared_ptr<World> world)
    : first_coil_(config.coil.value_or(0)), world_(std::move(world)) {
  const auto& fixed = std::get<FixedLampsKinematics>(world_->rig().gantry.model.kinematics);
  on_.assign(fixed.lamps.size(), false);
}

std::optional<std::size_t> LampBankRegisters::lamp_at(RegisterTable table, int address) const {
  const int lamp = address - first_coil_;
  if (table != RegisterTable::coil || lamp < 0 || lamp >= static_cast<int>(on_.size()))
    return std::nullopt;
  return static_cast<std::size_t>(lamp);
}

std::optional<std::uint16_t> LampBankRegisters::read(RegisterTable table, int address) const {
  const auto lamp = lamp_at(table, address);
  if (!lamp) return std::nullopt;
  return static_cast<std::uint16_t>(on_[*lamp] && world_->lamp_power() > 0 ? 1 : 0);
}

std::optional<ModbusException> LampBankRegisters::write(RegisterTable table, int address,
                                                        std::uint16_t value) {
  const auto lamp = lamp_at(table, address);
  if (!lamp) return ModbusException::illegal_address;
  on_[*lamp] = value != 0;
  return obey();
}

// In the laboratory to choose a lamp is to move to it, which needs a homed gantry and no time.
std::optional<ModbusException> LampBankRegisters::obey() {
  if (std::count(on_.begin(), on_.end(), true) != 1) {
    static_cast<void>(world_->set_lamp(0));
    return std::nullopt;
  }
  const auto chosen = static_cast<double>(std::find(on_.begin(), on_.end(), true) - on_.begin());
  const GantryStatus status = world_->gantry_status();
  if (!status.homed && !world_->start_homing()) return ModbusException::device_failure;
  if ((!status.homed || status.position.axes[0] != chosen) && !world_->start_axis_move(0, chosen))
    return ModbusException::device_failure;
  if (!world_->set_lamp(1)) return ModbusException::device_failure;
  return std::nullopt;
}

void LampBankRegisters::reboot() {
  std::fill(on_.begin(), on_.end(), false);
  static_cast<void>(world_->set_lamp(0));
}

}  // namespace lightrig::sim
