#include "sim/modbus/drive_registers.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "config/register_value.h"

namespace lightrig::sim {
namespace {

bool is_bits(RegisterTable table) {
  return table == RegisterTable::coil || table == RegisterTable::discrete;
}

std::uint16_t word_of(const RegisterItem& item, std::int64_t raw, int word) {
  const auto bits = static_cast<std::uint32_t>(raw);
  if (item.registers() == 1) return static_cast<std::uint16_t>(bits & 0xffff);
  const bool high = (word == 0) == (item.order == WordOrder::high_first);
  return static_cast<std::uint16_t>(high ? bits >> 16 : bits & 0xffff);
}

}  // namespace

DriveRegisters::DriveRegisters(const ModbusGantry& backend, std::size_t axis,
                               std::shared_ptr<World> world)
    : profile_(backend.controller),
      config_(backend.drives[axis]),
      axis_(axis),
      world_(std::move(world)),
      enabled_(!backend.controller.enable) {
  for (const ProfileCommand* command : {&profile_.move, &profile_.home, &profile_.stop})
    declare(*command);
  for (const auto* command : {&profile_.enable, &profile_.reset_alarm})
    if (*command) declare(**command);
  declare(profile_.position);
  for (const auto* bit : {&profile_.ready, &profile_.moving, &profile_.in_position, &profile_.homed,
                          &profile_.alarm, &profile_.enabled, &profile_.e_stop})
    declare(*bit);
  if (profile_.alarm_code) declare(*profile_.alarm_code);
  if (profile_.watchdog) declare(profile_.watchdog->item);
  for (const auto& [name, output] : profile_.outputs)
    words_[{output.table, output.address}] = static_cast<std::uint16_t>(output.off);
  for (const auto& [name, input] : profile_.inputs) declare(std::optional(input));
  if (profile_.known) {
    declare(profile_.known->item);
    for (int word = 0; word < profile_.known->item.registers(); ++word)
      words_[{profile_.known->item.table, profile_.known->item.address + word}] =
          word_of(profile_.known->item, profile_.known->value, word);
  }
  factory_ = words_;
  heard_ = world_->clock().now();
}

void DriveRegisters::heard() { heard_ = world_->clock().now(); }

bool DriveRegisters::carries_lamp() const {
  const auto* lamp = std::get_if<GantryLamp>(&world_->rig().lamp.backend);
  return axis_ == 0 && lamp != nullptr;
}

void DriveRegisters::tick() {
  if (!profile_.watchdog) return;
  const RegisterItem& item = profile_.watchdog->item;
  const std::int64_t raw = raw_of(item, stored(item, 0), stored(item, 1));
  const double seconds = value_of_raw(item, raw);
  if (raw == 0 || !(seconds > 0)) return;
  const double silent = std::chrono::duration<double>(world_->clock().now() - heard_).count();
  if (silent < seconds || !world_->gantry_status().alarm.empty()) return;
  if (carries_lamp()) {
    static_cast<void>(world_->switch_lamp(0));
    for (const auto& [name, output] : profile_.outputs)
      words_[{output.table, output.address}] = static_cast<std::uint16_t>(output.off);
  }
  world_->raise_alarm("communication watchdog");
}

void DriveRegisters::reboot() {
  words_ = factory_;
  enabled_ = !profile_.enable;
  heard_ = world_->clock().now();
  if (carries_lamp()) static_cast<void>(world_->switch_lamp(0));
  world_->lose_position();
}

// The number whose text the alarm is; for an alarm given by number, that; else the first there is.
std::uint16_t DriveRegisters::alarm_code(const std::string& alarm) const {
  if (alarm.starts_with("code "))
    if (const int code = std::atoi(alarm.c_str() + 5); code > 0)
      return static_cast<std::uint16_t>(code);
  for (const auto& [code, text] : profile_.alarm_texts)
    if (text == alarm) return static_cast<std::uint16_t>(code);
  return profile_.alarm_texts.empty()
             ? std::uint16_t{1}
             : static_cast<std::uint16_t>(profile_.alarm_texts.begin()->first);
}

void DriveRegisters::declare(const RegisterItem& item) {
  for (int word = 0; word < item.registers(); ++word)
    words_.try_emplace({item.table, item.address + word}, 0);
}

void DriveRegisters::declare(const ProfileCommand& command) {
  for (const ProfileWrite& write : command.writes) declare(write.item);
  if (command.trigger.style != TriggerStyle::implicit)
    words_.try_emplace({command.trigger.table, command.trigger.address},
                       static_cast<std::uint16_t>(command.trigger.clear));
}

void DriveRegisters::declare(const std::optional<StatusBit>& bit) {
  if (bit) words_.try_emplace({bit->table, bit->address}, 0);
}

std::int64_t DriveRegisters::raw_position() const {
  const GantryStatus status = world_->gantry_status();
  const double counts = (status.position.axes[static_cast<Eigen::Index>(axis_)] - config_.zero) *
                        config_.counts_per_si;
  return std::llround(counts * profile_.position.scale + profile_.position.offset);
}

void DriveRegisters::show(std::uint16_t& word, const std::optional<StatusBit>& bit, const Key& key,
                          bool standing) const {
  if (!bit || Key{bit->table, bit->address} != key) return;
  if (is_bits(bit->table)) {
    word = static_cast<std::uint16_t>(standing ? bit->value : 1 - bit->value);
    return;
  }
  const auto mask = static_cast<std::uint16_t>(bit->mask);
  const int value = standing ? bit->value : (bit->value == 0 ? bit->mask : 0);
  word = static_cast<std::uint16_t>((word & ~mask) | (value & mask));
}

// Registers that the drive itself keeps up to date; the others hold what was last written.
std::optional<std::uint16_t> DriveRegisters::live(RegisterTable table, int address) const {
  const RegisterItem& position = profile_.position;
  if (table == position.table && address >= position.address &&
      address < position.address + position.registers())
    return word_of(position, raw_position(), address - position.address);
  if (const auto* lamp = std::get_if<GantryLamp>(&world_->rig().lamp.backend)) {
    // The lamp's output shows what the lamp does: one that failed or was cut off reads dark.
    const auto output = profile_.outputs.find(lamp->output);
    if (output != profile_.outputs.end() && output->second.table == table &&
        output->second.address == address)
      return static_cast<std::uint16_t>(std::lround(
          output->second.off + world_->lamp_power() * (output->second.on - output->second.off)));
  }
  const GantryStatus status = world_->gantry_status();
  if (profile_.alarm_code && table == profile_.alarm_code->table &&
      address >= profile_.alarm_code->address &&
      address < profile_.alarm_code->address + profile_.alarm_code->registers())
    return word_of(*profile_.alarm_code, status.alarm.empty() ? 0 : alarm_code(status.alarm),
                   address - profile_.alarm_code->address);
  const Key key{table, address};
  std::uint16_t word = 0;
  const bool alarm = !status.alarm.empty();
  const bool stopped =
      std::count(status.open_interlocks.begin(), status.open_interlocks.end(), "e_stop") > 0;
  show(word, profile_.moving, key, !status.at_rest);
  show(word, profile_.in_position, key, status.at_rest);
  show(word, profile_.ready, key, status.at_rest && enabled_ && !alarm);
  show(word, profile_.homed, key, world_->axis_homed(axis_));
  show(word, profile_.alarm, key, alarm);
  show(word, profile_.enabled, key, enabled_);
  show(word, profile_.e_stop, key, stopped);
  for (const auto& [name, input] : profile_.inputs) {
    const bool open =
        std::any_of(world_->rig().interlocks.begin(), world_->rig().interlocks.end(),
                    [&, &input_name = name](const Interlock& interlock) {
                      return interlock.input == input_name &&
                             std::count(status.open_interlocks.begin(),
                                        status.open_interlocks.end(), interlock.name) > 0;
                    });
    show(word, std::optional(input), key, !open);
  }
  const bool is_status = [&] {
    for (const auto* bit : {&profile_.moving, &profile_.in_position, &profile_.ready,
                            &profile_.homed, &profile_.alarm, &profile_.enabled, &profile_.e_stop})
      if (*bit && Key{(*bit)->table, (*bit)->address} == key) return true;
    return std::any_of(profile_.inputs.begin(), profile_.inputs.end(), [&](const auto& input) {
      return Key{input.second.table, input.second.address} == key;
    });
  }();
  if (is_status) return word;
  return std::nullopt;
}

std::optional<std::uint16_t> DriveRegisters::read(RegisterTable table, int address) const {
  const auto found = words_.find({table, address});
  if (found == words_.end()) return std::nullopt;
  if (const auto now = live(table, address)) return now;
  return found->second;
}

bool DriveRegisters::fires(const ProfileCommand& command, const Key& key, std::uint16_t before,
                           std::uint16_t now) const {
  const Trigger& trigger = command.trigger;
  if (trigger.style == TriggerStyle::implicit) {
    if (command.writes.empty()) return false;
    const RegisterItem& last = command.writes.back().item;
    if (Key{last.table, last.address + last.registers() - 1} != key) return false;
    const ProfileWrite& write = command.writes.back();
    // Two commands may end in the same register: the constant tells them apart.
    return write.quantity != Quantity::constant ||
           now == word_of(last, write.constant, last.registers() - 1);
  }
  if (Key{trigger.table, trigger.address} != key) return false;
  const auto set = static_cast<std::uint16_t>(trigger.set);
  if (trigger.style == TriggerStyle::edge || trigger.style == TriggerStyle::level_clear)
    return now == set && before != set;
  return now == set;
}

std::uint16_t DriveRegisters::stored(const RegisterItem& item, int word) const {
  const auto found = words_.find({item.table, item.address + word});
  return found == words_.end() ? std::uint16_t{0} : found->second;
}

std::optional<ModbusException> DriveRegisters::start_move() {
  if (!enabled_) return ModbusException::device_failure;
  for (const ProfileWrite& write : profile_.move.writes) {
    const bool rate = write.quantity == Quantity::speed ||
                      write.quantity == Quantity::acceleration ||
                      write.quantity == Quantity::deceleration;
    if (rate && raw_of(write.item, stored(write.item, 0), stored(write.item, 1)) <= 0)
      return ModbusException::illegal_value;
  }
  for (const ProfileWrite& write : profile_.move.writes) {
    if (write.quantity != Quantity::position) continue;
    const RegisterItem& item = write.item;
    const double counts = value_of_raw(item, raw_of(item, stored(item, 0), stored(item, 1)));
    if (!world_->start_axis_move(axis_, config_.zero + counts / config_.counts_per_si))
      return ModbusException::device_failure;
  }
  return std::nullopt;
}

std::optional<ModbusException> DriveRegisters::obey(const Key& key, std::uint16_t before,
                                                    std::uint16_t now) {
  if (profile_.enable && fires(*profile_.enable, key, before, now)) {
    enabled_ = true;
  } else if (profile_.enable && profile_.enable->trigger.style == TriggerStyle::value && now == 0 &&
             Key{profile_.enable->trigger.table, profile_.enable->trigger.address} == key) {
    // 0 in the register that holds the motor lets it go.
    enabled_ = false;
    world_->halt_axis(axis_);
  }
  if (fires(profile_.stop, key, before, now)) world_->halt_axis(axis_);
  if (profile_.reset_alarm && fires(*profile_.reset_alarm, key, before, now))
    (void)world_->clear_fault();
  if (fires(profile_.home, key, before, now)) {
    if (!enabled_ || !world_->start_axis_homing(axis_)) return ModbusException::device_failure;
  }
  if (fires(profile_.move, key, before, now)) return start_move();
  for (const auto& [name, output] : profile_.outputs) {
    if (Key{output.table, output.address} != key) continue;
    const double power = static_cast<double>(now - output.off) / (output.on - output.off);
    const auto* lamp = std::get_if<GantryLamp>(&world_->rig().lamp.backend);
    if (lamp && lamp->output == name && !world_->switch_lamp(power))
      return ModbusException::illegal_value;
  }
  return std::nullopt;
}

std::optional<ModbusException> DriveRegisters::write(RegisterTable table, int address,
                                                     std::uint16_t value) {
  const auto found = words_.find({table, address});
  if (found == words_.end()) return ModbusException::illegal_address;
  const std::uint16_t before = found->second;
  found->second = value;
  return obey({table, address}, before, value);
}

}  // namespace lightrig::sim
