#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "config/rig.h"
#include "sim/modbus/modbus_unit.h"
#include "sim/world.h"

namespace lightrig::sim {

/// A lamp on a Modbus unit of its own: one coil or one holding register.
class LampRegister final : public ModbusUnit {
 public:
  LampRegister(const ModbusLamp& config, std::shared_ptr<World> world)
      : config_(config), world_(std::move(world)) {}

  std::optional<std::uint16_t> read(RegisterTable table, int address) const override;
  std::optional<ModbusException> write(RegisterTable table, int address,
                                       std::uint16_t value) override;
  void heard() override {}
  void tick() override {}
  void reboot() override { static_cast<void>(world_->switch_lamp(0)); }

 private:
  bool is_mine(RegisterTable table, int address) const;
  double full() const { return config_.coil ? 1.0 : config_.full_scale; }

  const ModbusLamp config_;
  std::shared_ptr<World> world_;
};

/// Fixed lamps on consecutive coils of one unit. Its switch lets no two burn: while more than one
/// coil is on, all are dark.
class LampBankRegisters final : public ModbusUnit {
 public:
  LampBankRegisters(const ModbusLamp& config, std::shared_ptr<World> world);

  std::optional<std::uint16_t> read(RegisterTable table, int address) const override;
  std::optional<ModbusException> write(RegisterTable table, int address,
                                       std::uint16_t value) override;
  void heard() override {}
  void tick() override {}
  void reboot() override;

 private:
  std::optional<std::size_t> lamp_at(RegisterTable table, int address) const;
  std::optional<ModbusException> obey();

  const int first_coil_;
  std::shared_ptr<World> world_;
  std::vector<bool> on_;
};

}  // namespace lightrig::sim
