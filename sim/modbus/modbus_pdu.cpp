#include "sim/modbus/modbus_pdu.h"

namespace lightrig::sim {
namespace {

constexpr std::uint8_t illegal_function = 1;
constexpr std::uint8_t illegal_address = 2;
constexpr std::uint8_t illegal_value = 3;

int word_at(std::span<const std::uint8_t> bytes, std::size_t i) {
  return (bytes[i] << 8) | bytes[i + 1];
}

Bytes exception(std::uint8_t function, std::uint8_t code) {
  return {static_cast<std::uint8_t>(function | 0x80), code};
}

std::optional<RegisterTable> table_of(std::uint8_t function) {
  switch (function) {
    case 0x01:
    case 0x05:
    case 0x0f:
      return RegisterTable::coil;
    case 0x02:
      return RegisterTable::discrete;
    case 0x03:
    case 0x06:
    case 0x10:
      return RegisterTable::holding;
    case 0x04:
      return RegisterTable::input;
    default:
      return std::nullopt;
  }
}

Bytes answer_read(ModbusUnit& unit, RegisterTable table, std::span<const std::uint8_t> request) {
  const bool bits = table == RegisterTable::coil || table == RegisterTable::discrete;
  const int address = word_at(request, 1);
  const int count = word_at(request, 3);
  if (count < 1 || count > (bits ? 2000 : 125)) return exception(request[0], illegal_value);
  Bytes data(static_cast<std::size_t>(bits ? (count + 7) / 8 : 2 * count));
  for (int i = 0; i < count; ++i) {
    const auto value = unit.read(table, address + i);
    if (!value) return exception(request[0], illegal_address);
    const auto at = static_cast<std::size_t>(i);
    if (bits) {
      if (*value != 0) data[at / 8] = static_cast<std::uint8_t>(data[at / 8] | (1U << (at % 8)));
    } else {
      data[2 * at] = static_cast<std::uint8_t>(*value >> 8);
      data[2 * at + 1] = static_cast<std::uint8_t>(*value & 0xff);
    }
  }
  Bytes answer{request[0], static_cast<std::uint8_t>(data.size())};
  answer.insert(answer.end(), data.begin(), data.end());
  return answer;
}

Bytes answer_write_one(ModbusUnit& unit, RegisterTable table,
                       std::span<const std::uint8_t> request) {
  int value = word_at(request, 3);
  if (table == RegisterTable::coil) {
    if (value != 0 && value != 0xff00) return exception(request[0], illegal_value);
    value = value != 0 ? 1 : 0;
  }
  const auto refused = unit.write(table, word_at(request, 1), static_cast<std::uint16_t>(value));
  if (refused) return exception(request[0], static_cast<std::uint8_t>(*refused));
  return {request.begin(), request.end()};
}

Bytes answer_write_many(ModbusUnit& unit, RegisterTable table,
                        std::span<const std::uint8_t> request) {
  const bool bits = table == RegisterTable::coil;
  const int address = word_at(request, 1);
  const int count = word_at(request, 3);
  const std::size_t bytes = static_cast<std::size_t>(bits ? (count + 7) / 8 : 2 * count);
  if (count < 1 || count > (bits ? 1968 : 123) || request.size() < 6 || request[5] != bytes ||
      request.size() != 6 + bytes)
    return exception(request[0], illegal_value);
  // All or nothing: an address that does not exist refuses the block before any of it acts.
  for (int i = 0; i < count; ++i)
    if (!unit.read(table, address + i)) return exception(request[0], illegal_address);
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const int value = bits ? (request[6 + at / 8] >> (at % 8)) & 1 : word_at(request, 6 + 2 * at);
    const auto refused = unit.write(table, address + i, static_cast<std::uint16_t>(value));
    if (refused) return exception(request[0], static_cast<std::uint8_t>(*refused));
  }
  return {request.begin(), request.begin() + 5};
}

}  // namespace

Bytes answer_pdu(ModbusUnit& unit, std::span<const std::uint8_t> request) {
  if (request.empty()) return {};
  const auto table = table_of(request[0]);
  if (!table) return exception(request[0], illegal_function);
  if (request.size() < 5) return exception(request[0], illegal_value);
  if (request[0] <= 0x04) return answer_read(unit, *table, request);
  if (request[0] <= 0x06) return answer_write_one(unit, *table, request);
  return answer_write_many(unit, *table, request);
}

std::uint16_t crc16(std::span<const std::uint8_t> bytes) {
  std::uint16_t crc = 0xffff;
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint16_t>(crc ^ byte);
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ 0xa001 : crc >> 1);
  }
  return crc;
}

std::optional<std::size_t> rtu_request_length(std::span<const std::uint8_t> begun) {
  if (begun.size() < 2) return std::nullopt;
  const std::uint8_t function = begun[1];
  if (!table_of(function)) return 0;
  if (function <= 0x06) return 8;
  if (begun.size() < 7) return std::nullopt;
  return 9 + std::size_t{begun[6]};
}

}  // namespace lightrig::sim
