#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "config/rig.h"
#include "sim/modbus/modbus_unit.h"
#include "sim/world.h"

namespace lightrig::sim {

/// The inside of one drive: the registers its profile describes, moving one axis of the world. What
/// the profile does not name does not exist. No wire, no thread.
class DriveRegisters final : public ModbusUnit {
 public:
  DriveRegisters(const ModbusGantry& backend, std::size_t axis, std::shared_ptr<World> world);

  std::optional<std::uint16_t> read(RegisterTable table, int address) const override;
  std::optional<ModbusException> write(RegisterTable table, int address,
                                       std::uint16_t value) override;
  void heard() override;
  /// The drive's own watchdog, once written: silence for so long raises an alarm, halts, and
  /// switches the outputs off.
  void tick() override;
  void reboot() override;
  std::chrono::milliseconds gap() const override { return profile_.frame_gap; }

 private:
  using Key = std::pair<RegisterTable, int>;
  void declare(const RegisterItem& item);
  void declare(const ProfileCommand& command);
  void declare(const std::optional<StatusBit>& bit);
  bool holds(const StatusBit& bit, bool standing) const;
  bool fires(const ProfileCommand& command, const Key& key, std::uint16_t before,
             std::uint16_t now) const;
  std::optional<ModbusException> obey(const Key& key, std::uint16_t before, std::uint16_t now);
  std::optional<ModbusException> start_move();
  std::int64_t raw_position() const;
  std::uint16_t alarm_code(const std::string& alarm) const;
  bool carries_lamp() const;
  std::optional<std::uint16_t> live(RegisterTable table, int address) const;
  void show(std::uint16_t& word, const std::optional<StatusBit>& bit, const Key& key,
            bool standing) const;
  std::uint16_t stored(const RegisterItem& item, int word) const;

  const ControllerProfile profile_;
  const ModbusDrive config_;
  const std::size_t axis_;
  std::shared_ptr<World> world_;
  std::map<Key, std::uint16_t> words_;
  std::map<Key, std::uint16_t> factory_;  ///< words_ at power-on
  bool enabled_ = false;
  TimePoint heard_;
};

}  // namespace lightrig::sim
