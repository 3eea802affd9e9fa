#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

// The bytes of GigE Vision's two protocols [GigE Vision 2.0], as the camera's side needs them:
// GVCP, the control channel, and GVSP, the stream. All numbers on the wire are big-endian.
namespace lightrig::sim {

using Packet = std::vector<std::uint8_t>;

void append16(Packet& packet, std::uint32_t value);
void append32(Packet& packet, std::uint32_t value);
std::uint32_t word_at(std::span<const std::uint8_t> bytes, std::size_t offset);

/// How a command was answered; the value is the wire's status code.
enum class GvStatus : std::uint16_t {
  ok = 0x0000,
  not_implemented = 0x8001,
  invalid_parameter = 0x8002,
  invalid_address = 0x8003,
  write_protect = 0x8004,
  bad_alignment = 0x8005,
  access_denied = 0x8006,
  busy = 0x8007,
};

namespace gvcp {

constexpr std::uint16_t port = 3956;
constexpr std::size_t header_bytes = 8;
constexpr std::size_t most_memory_bytes = 536;  ///< of one READMEM or WRITEMEM
constexpr std::size_t discovery_bytes = 0xf8;

enum Code : std::uint16_t {
  discovery = 0x0002,
  packet_resend = 0x0040,
  read_register = 0x0080,
  write_register = 0x0082,
  read_memory = 0x0084,
  write_memory = 0x0086,
};

struct Command {
  std::uint16_t code = 0;
  std::uint16_t id = 0;  ///< never 0; the answer carries it
  bool wants_answer = true;
  std::span<const std::uint8_t> data;
};

/// A command from a datagram; nothing when it is none.
std::optional<Command> read_command(std::span<const std::uint8_t> datagram);
/// The acknowledgement of a command, or its refusal with the reason.
Packet answer(const Command& command, GvStatus status, std::span<const std::uint8_t> data);

}  // namespace gvcp

namespace gvsp {

constexpr std::size_t header_bytes = 8;
constexpr std::size_t overhead_bytes = 20 + 8 + header_bytes;  ///< IP, UDP and GVSP headers

/// What the leader says of the image that follows.
struct ImageFacts {
  std::uint64_t timestamp = 0;  ///< [ticks] of the camera's clock, at the start of the exposure
  std::uint32_t pixel_format = 0;
  std::uint32_t width = 0, height = 0;
  std::uint32_t x = 0, y = 0;  ///< [px] where it lies on the sensor
  bool chunks = false;         ///< chunk data follow the image
};

constexpr std::uint16_t resent = 0x0100;       ///< status of a packet sent again
constexpr std::uint16_t unavailable = 0x800c;  ///< status of one that is no longer there

/// Packet 0 of a block.
Packet leader(std::uint16_t block, const ImageFacts& facts, std::uint16_t status);
/// Packet 1 … n: the header of a payload packet; the bytes of the image follow.
Packet payload_header(std::uint16_t block, std::uint32_t packet, std::uint16_t status);
/// Packet n + 1.
Packet trailer(std::uint16_t block, std::uint32_t packet, const ImageFacts& facts,
               std::uint16_t status);

}  // namespace gvsp

}  // namespace lightrig::sim
