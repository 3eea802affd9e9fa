#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "config/rig.h"
#include "sim/world.h"

namespace lightrig::sim {

/// Why a request is answered by an exception [Modbus Application Protocol 1.1b3, 7].
enum class ModbusException : std::uint8_t {
  illegal_address = 2,
  illegal_value = 3,
  device_failure = 4
};

/// The inside of one drive: the registers its profile describes, moving one axis of the world. What
/// the profile does not name does not exist. No wire, no thread.
class DriveRegisters {
 public:
  DriveRegisters(const ModbusGantry& backend, std::size_t axis, std::shared_ptr<World> world);

  std::optional<std::uint16_t> read(RegisterTable table, int address) const;
  /// Obeys a write, and whatever it triggers.
  std::optional<ModbusException> write(RegisterTable table, int address, std::uint16_t value);

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
  std::optional<std::uint16_t> live(RegisterTable table, int address) const;
  void show(std::uint16_t& word, const std::optional<StatusBit>& bit, const Key& key,
            bool standing) const;
  std::uint16_t stored(const RegisterItem& item, int word) const;

  const ControllerProfile profile_;
  const ModbusDrive config_;
  const std::size_t axis_;
  std::shared_ptr<World> world_;
  std::map<Key, std::uint16_t> words_;
  bool enabled_ = false;
};

}  // namespace lightrig::sim
