#include "drivers/modbus/modbus_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "config/register_value.h"

namespace lightrig {
namespace {

struct RawRange {
  double least, most;
};

RawRange range_of(RawType type) {
  switch (type) {
    case RawType::u16:
      return {0, 65535};
    case RawType::s16:
      return {-32768, 32767};
    case RawType::u32:
      return {0, 4294967295.0};
    case RawType::s32:
      return {-2147483648.0, 2147483647.0};
  }
  return {0, 0};
}

bool is_set(const StatusBit& bit, std::uint16_t word) {
  const bool one_bit = bit.table == RegisterTable::coil || bit.table == RegisterTable::discrete;
  return (one_bit ? word : word & bit.mask) == bit.value;
}

/// Of one read request [Modbus application protocol 1.1b3, 6.1 and 6.3].
constexpr int most_registers = 125;

}  // namespace

std::vector<RegisterSpan> joined(std::vector<RegisterSpan> spans) {
  std::ranges::sort(spans, {}, [](const RegisterSpan& s) { return std::pair(s.table, s.address); });
  std::vector<RegisterSpan> out;
  for (const RegisterSpan& span : spans) {
    const int end = span.address + span.count;
    if (!out.empty() && out.back().table == span.table &&
        span.address <= out.back().address + out.back().count &&
        end - out.back().address <= most_registers)
      out.back().count = std::max(out.back().count, end - out.back().address);
    else
      out.push_back(span);
  }
  return out;
}

Result<std::vector<std::uint16_t>> encode_raw(const RegisterItem& item, double raw) {
  const RawRange range = range_of(item.type);
  const double rounded = std::nearbyint(raw);
  if (!(rounded >= range.least && rounded <= range.most))
    return fail(ErrorCode::invalid_input,
                fmt::format("{} does not fit register {:#06x} ({} … {})", rounded, item.address,
                            range.least, range.most));
  const auto bits = static_cast<std::uint32_t>(static_cast<std::int64_t>(rounded));
  const auto low = static_cast<std::uint16_t>(bits & 0xffff);
  const auto high = static_cast<std::uint16_t>(bits >> 16);
  if (item.registers() == 1) return std::vector<std::uint16_t>{low};
  if (item.order == WordOrder::high_first) return std::vector<std::uint16_t>{high, low};
  return std::vector<std::uint16_t>{low, high};
}

Result<std::vector<std::uint16_t>> encode(const RegisterItem& item, double value) {
  return encode_raw(item, value * item.scale + item.offset);
}

std::int64_t decode_raw(const RegisterItem& item, const std::vector<std::uint16_t>& registers) {
  return raw_of(item, registers.front(), registers.back());
}

double decode(const RegisterItem& item, const std::vector<std::uint16_t>& registers) {
  return value_of_raw(item, decode_raw(item, registers));
}

namespace {

double value_of(const ModbusDrive& config, const ProfileWrite& write, const DriveMove& move) {
  const double counts_per_si = config.counts_per_si;
  const double magnitude = std::abs(counts_per_si);
  double counts = 0;
  switch (write.quantity) {
    case Quantity::constant:
      return static_cast<double>(write.constant);
    case Quantity::position:
      return (move.position - config.zero) * counts_per_si;
    case Quantity::speed:
      counts = move.speed * magnitude;
      break;
    case Quantity::acceleration:
    case Quantity::deceleration:
      counts = move.acceleration * magnitude;
      break;
  }
  switch (write.item.unit) {
    case RawUnit::rpm:
      return counts / config.counts_per_rev * 60;
    case RawUnit::ms_per_1000_rpm:
      // [ms] in which the motor gains 1000 rpm.
      return 1000 * (1000.0 / 60 * config.counts_per_rev) / counts;
    default:
      return counts;
  }
}

Result<std::vector<std::uint16_t>> words_of(const ModbusDrive& config, const ProfileWrite& write,
                                            const DriveMove& move) {
  const RegisterItem& item = write.item;
  const double value = value_of(config, write, move);
  switch (write.quantity) {
    case Quantity::constant:
      return encode_raw(item, value);
    case Quantity::position:
      return encode(item, value);
    case Quantity::speed:
    case Quantity::acceleration:
    case Quantity::deceleration:
      break;
  }
  const RawRange range = range_of(item.type);
  return encode_raw(
      item, std::clamp(value * item.scale + item.offset, std::max(1.0, range.least), range.most));
}

}  // namespace

Result<std::vector<RegisterWrite>> composed(const ModbusDrive& config,
                                            const ProfileCommand& command, const DriveMove& move) {
  std::vector<RegisterWrite> writes;
  for (const ProfileWrite& write : command.writes) {
    auto words = words_of(config, write, move);
    if (!words) return tl::unexpected(words.error());
    const RegisterItem& item = write.item;
    if (command.block && !writes.empty())
      writes.front().words.insert(writes.front().words.end(), words->begin(), words->end());
    else
      writes.push_back({item.table, item.address, *words, command.block || words->size() > 1});
  }
  return writes;
}

Result<void> can_hold_limits(const ModbusDrive& config, const ProfileCommand& move,
                             double max_speed, double max_acceleration) {
  for (const ProfileWrite& write : move.writes) {
    if (write.quantity == Quantity::constant || write.quantity == Quantity::position) continue;
    const RegisterItem& item = write.item;
    const double raw =
        value_of(config, write, {0, max_speed, max_acceleration}) * item.scale + item.offset;
    if (raw >= 1 && raw <= range_of(item.type).most) continue;
    return fail(
        ErrorCode::invalid_input,
        fmt::format("axis {}: its greatest {} is {:.3g} in the units of register {:#06x}, "
                    "which holds 1 … {:.0f}: the drive could not keep to it",
                    config.axis, write.quantity == Quantity::speed ? "speed" : "acceleration", raw,
                    item.address, range_of(item.type).most));
  }
  return {};
}

Result<void> ModbusDriveDevice::prepare(const Until& until) {
  if (profile_.known) {
    const RegisterItem& item = profile_.known->item;
    auto words = bus_.read(config_.unit, item.table, item.address, item.registers(), until);
    if (!words) return tl::unexpected(words.error());
    if (decode_raw(item, *words) != profile_.known->value)
      return fail(
          ErrorCode::invalid_input,
          fmt::format("register {:#06x} of unit {} holds {}, a {} would hold {}: is this the "
                      "right controller profile and unit number?",
                      item.address, config_.unit, decode_raw(item, *words), profile_.name,
                      profile_.known->value));
  }
  if (!profile_.watchdog) return {};
  const RegisterItem& item = profile_.watchdog->item;
  auto words = encode(item, std::chrono::duration<double>(profile_.watchdog->timeout).count());
  if (!words) return tl::unexpected(with_context("drive watchdog", words.error()));
  if (auto done =
          bus_.write(config_.unit, item.table, item.address, *words, words->size() > 1, until);
      !done)
    return tl::unexpected(with_context("set the drive's watchdog", done.error()));
  auto back = bus_.read(config_.unit, item.table, item.address, item.registers(), until);
  if (!back) return tl::unexpected(with_context("read the drive's watchdog back", back.error()));
  if (*back != *words)
    return fail(ErrorCode::refused,
                fmt::format("the drive of axis {} did not take its watchdog time", config_.axis));
  return {};
}

Result<void> ModbusDriveDevice::put(const Trigger& trigger, std::int64_t value, const Until& until,
                                    Delivery delivery) {
  return bus_.write(config_.unit, trigger.table, trigger.address,
                    {static_cast<std::uint16_t>(value)}, false, until, delivery);
}

Result<void> ModbusDriveDevice::begin(const ProfileCommand& command,
                                      const std::vector<RegisterWrite>& writes, const Until& until,
                                      Delivery delivery) {
  Result<void> all;
  const auto go_on_after = [&](const Result<void>& done) {
    if (!done && all) all = done;
    // Of what is sent at any rate the rest is sent too: no answer need not mean not heard.
    return done || delivery == Delivery::sent_only;
  };
  for (const RegisterWrite& write : writes)
    if (!go_on_after(bus_.write(config_.unit, write.table, write.address, write.words,
                                write.multiple, until, delivery)))
      return all;
  const Trigger& trigger = command.trigger;
  if (trigger.style == TriggerStyle::implicit) return all;
  if (trigger.style == TriggerStyle::edge &&
      !go_on_after(put(trigger, trigger.clear, until, delivery)))
    return all;
  go_on_after(put(trigger, trigger.set, until, delivery));
  return all;
}

Result<void> ModbusDriveDevice::end(const ProfileCommand& command, const Until& until,
                                    Delivery delivery) {
  const TriggerStyle style = command.trigger.style;
  if (style == TriggerStyle::implicit || style == TriggerStyle::value) return {};
  return put(command.trigger, command.trigger.clear, until, delivery);
}

Result<void> ModbusDriveDevice::run(const ProfileCommand& command, const Until& until) {
  const auto writes = composed(config_, command, {});
  if (!writes) return tl::unexpected(writes.error());
  if (auto begun = begin(command, *writes, until); !begun) return begun;
  if (command.trigger.style != TriggerStyle::implicit &&
      command.trigger.style != TriggerStyle::value)
    clock_.sleep_until(clock_.now() + command.trigger.pulse, until.stop);
  return end(command, until);
}

Result<ModbusDriveDevice::Seen> ModbusDriveDevice::read_all(const std::vector<RegisterSpan>& spans,
                                                            const Until& until) {
  Seen seen;
  for (const RegisterSpan& span : spans) {
    const auto words = bus_.read(config_.unit, span.table, span.address, span.count, until);
    if (!words) return tl::unexpected(words.error());
    for (int i = 0; i < span.count; ++i)
      seen[{span.table, span.address + i}] = (*words)[static_cast<std::size_t>(i)];
  }
  return seen;
}

Result<std::vector<bool>> ModbusDriveDevice::bits(const std::vector<StatusBit>& wanted,
                                                  const Until& until) {
  std::vector<RegisterSpan> spans;
  for (const StatusBit& bit : wanted) spans.push_back({bit.table, bit.address, 1});
  const auto seen = read_all(joined(std::move(spans)), until);
  if (!seen) return tl::unexpected(seen.error());
  std::vector<bool> values;
  for (const StatusBit& bit : wanted)
    values.push_back(is_set(bit, seen->at({bit.table, bit.address})));
  return values;
}

Result<std::string> ModbusDriveDevice::alarm_of(const Until& until) {
  if (!profile_.alarm_code) return fmt::format("axis {}: alarm", config_.axis);
  const RegisterItem& item = *profile_.alarm_code;
  auto words = bus_.read(config_.unit, item.table, item.address, item.registers(), until);
  if (!words) return tl::unexpected(words.error());
  const std::int64_t code = decode_raw(item, *words);
  const auto text = profile_.alarm_texts.find(code);
  return fmt::format("axis {}: alarm {:#x}{}", config_.axis, code,
                     text == profile_.alarm_texts.end() ? "" : ", " + text->second);
}

Result<DriveStatus> ModbusDriveDevice::status(const Until& until) {
  DriveStatus status;
  bool alarm = false;
  const std::pair<const std::optional<StatusBit>*, bool*> wanted[] = {
      {&profile_.moving, &status.moving}, {&profile_.in_position, &status.in_position},
      {&profile_.ready, &status.ready},   {&profile_.enabled, &status.enabled},
      {&profile_.homed, &status.homed},   {&profile_.alarm, &alarm},
      {&profile_.e_stop, &status.e_stop},
  };
  const RegisterItem& position = profile_.position;
  std::vector<RegisterSpan> spans{{position.table, position.address, position.registers()}};
  for (const auto& [which, into] : wanted)
    if (*which) spans.push_back({(*which)->table, (*which)->address, 1});
  const auto seen = read_all(joined(std::move(spans)), until);
  if (!seen) return tl::unexpected(seen.error());
  for (const auto& [which, into] : wanted)
    if (*which) *into = is_set(**which, seen->at({(*which)->table, (*which)->address}));
  if (!profile_.moving) status.moving = !status.in_position;
  status.has_homed_bit = profile_.homed.has_value();
  std::vector<std::uint16_t> words;
  for (int i = 0; i < position.registers(); ++i)
    words.push_back(seen->at({position.table, position.address + i}));
  status.position = config_.zero + decode(position, words) / config_.counts_per_si;
  if (alarm) {
    auto text = alarm_of(until);
    status.alarm = text ? *text : fmt::format("axis {}: alarm", config_.axis);
  }
  return status;
}

Result<void> ModbusDriveDevice::set_output(const ProfileOutput& output, double power,
                                           const Until& until) {
  const double raw = output.dimmable ? output.off + power * (output.on - output.off)
                                     : (power > 0 ? output.on : output.off);
  return bus_.write(config_.unit, output.table, output.address,
                    {static_cast<std::uint16_t>(std::lround(raw))}, false, until,
                    power > 0 ? Delivery::in_step : Delivery::sent_first);
}

Result<double> ModbusDriveDevice::read_output(const ProfileOutput& output, const Until& until) {
  auto words = bus_.read(config_.unit, output.table, output.address, 1, until);
  if (!words) return tl::unexpected(words.error());
  return (static_cast<double>(words->front()) - output.off) / (output.on - output.off);
}

}  // namespace lightrig
