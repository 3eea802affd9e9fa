#include "sim/aravis/gv_packets.h"

namespace lightrig::sim {

void append16(Packet& packet, std::uint32_t value) {
  packet.push_back(static_cast<std::uint8_t>(value >> 8));
  packet.push_back(static_cast<std::uint8_t>(value));
}

void append32(Packet& packet, std::uint32_t value) {
  append16(packet, value >> 16);
  append16(packet, value & 0xffff);
}

std::uint32_t word_at(std::span<const std::uint8_t> bytes, std::size_t offset) {
  return (std::uint32_t{bytes[offset]} << 24) | (std::uint32_t{bytes[offset + 1]} << 16) |
         (std::uint32_t{bytes[offset + 2]} << 8) | std::uint32_t{bytes[offset + 3]};
}

namespace gvcp {
namespace {

constexpr std::uint8_t command_key = 0x42;
constexpr std::uint8_t answer_required = 0x01;

}  // namespace

std::optional<Command> read_command(std::span<const std::uint8_t> datagram) {
  if (datagram.size() < header_bytes || datagram[0] != command_key) return std::nullopt;
  const std::size_t length = std::size_t{datagram[4]} << 8 | datagram[5];
  if (header_bytes + length > datagram.size()) return std::nullopt;
  Command command;
  command.code = static_cast<std::uint16_t>(datagram[2] << 8 | datagram[3]);
  command.id = static_cast<std::uint16_t>(datagram[6] << 8 | datagram[7]);
  command.wants_answer = (datagram[1] & answer_required) != 0;
  command.data = datagram.subspan(header_bytes, length);
  return command;
}

Packet answer(const Command& command, GvStatus status, std::span<const std::uint8_t> data) {
  const auto length = status == GvStatus::ok ? data.size() : 0;
  Packet packet;
  packet.reserve(header_bytes + length);
  append16(packet, static_cast<std::uint32_t>(status));
  append16(packet, command.code + 1U);  // every acknowledgement's code is its command's plus one
  append16(packet, static_cast<std::uint32_t>(length));
  append16(packet, command.id);
  packet.insert(packet.end(), data.begin(), data.begin() + static_cast<std::ptrdiff_t>(length));
  return packet;
}

}  // namespace gvcp

namespace gvsp {
namespace {

constexpr std::uint32_t leader_format = 1, trailer_format = 2, payload_format = 3;
constexpr std::uint32_t image_payload = 0x0001, chunks_follow = 0x4000;

Packet header(std::uint16_t block, std::uint32_t format, std::uint32_t packet,
              std::uint16_t status) {
  Packet bytes;
  bytes.reserve(64);
  append16(bytes, status);
  append16(bytes, block);
  append32(bytes, format << 24 | (packet & 0xffffff));
  return bytes;
}

std::uint32_t payload_type(const ImageFacts& facts) {
  return image_payload | (facts.chunks ? chunks_follow : 0);
}

}  // namespace

Packet leader(std::uint16_t block, const ImageFacts& facts, std::uint16_t status) {
  Packet bytes = header(block, leader_format, 0, status);
  append16(bytes, 0);  // one field, progressive
  append16(bytes, payload_type(facts));
  append32(bytes, static_cast<std::uint32_t>(facts.timestamp >> 32));
  append32(bytes, static_cast<std::uint32_t>(facts.timestamp));
  append32(bytes, facts.pixel_format);
  append32(bytes, facts.width);
  append32(bytes, facts.height);
  append32(bytes, facts.x);
  append32(bytes, facts.y);
  append32(bytes, 0);  // padding x and y
  return bytes;
}

Packet payload_header(std::uint16_t block, std::uint32_t packet, std::uint16_t status) {
  return header(block, payload_format, packet, status);
}

Packet trailer(std::uint16_t block, std::uint32_t packet, const ImageFacts& facts,
               std::uint16_t status) {
  Packet bytes = header(block, trailer_format, packet, status);
  append32(bytes, payload_type(facts));
  append32(bytes, facts.height);
  return bytes;
}

}  // namespace gvsp
}  // namespace lightrig::sim
