#include "sim/aravis/camera_registers.h"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "sim/aravis/camera_xml.h"

namespace lightrig::sim {
namespace {

constexpr std::size_t memory_bytes = 0xb000;
constexpr std::uint32_t least_packet = 576, most_packet = 9000;
constexpr std::uint32_t least_heartbeat_ms = 500;
constexpr std::uint32_t packet_size_mask = 0xffff;
constexpr std::uint32_t writable_packet_bits = 0x4000ffff;  // do-not-fragment, and the size
constexpr std::size_t chunk_bytes = 8, chunk_tail_bytes = 8;

/// Registers a controller may write; everything else is read only.
constexpr std::uint32_t writable[] = {
    reg_heartbeat,
    reg_timestamp_control,
    reg_privilege,
    reg_stream_port,
    reg_packet_size,
    reg_packet_delay,
    reg_stream_destination,
    reg_width,
    reg_height,
    reg_pixel_format,
    reg_acquisition_mode,
    reg_acquisition_start,
    reg_acquisition_stop,
    reg_offset_x,
    reg_offset_y,
    reg_reverse_x,
    reg_user_set_load,
    reg_trigger_mode,
    reg_trigger_mode + 4,
    reg_trigger_source,
    reg_trigger_software,
    reg_frame_rate_enable,
    reg_device_reset,
    reg_chunk_mode,
    reg_gamma_enable,
    reg_chunk_enable,
    reg_chunk_enable + 4,
    reg_chunk_enable + 8,
    reg_chunk_enable + 12,
    reg_chunk_enable + 16,
};
constexpr std::uint32_t writable_numbers[] = {reg_exposure_time, reg_gain, reg_frame_rate,
                                              reg_black_level};

bool is_number(std::uint32_t address) {
  return std::ranges::find(writable_numbers, address) != std::end(writable_numbers);
}

}  // namespace

CameraRegisters::CameraRegisters(const CameraBody& body)
    : body_(body), genicam_(camera_xml(body)), memory_(memory_bytes, 0) {
  fill_bootstrap();
  fill_features();
}

void CameraRegisters::set_text(std::uint32_t address, std::size_t room, const std::string& text) {
  const std::size_t length = std::min(room - 1, text.size());
  std::copy_n(text.begin(), length, memory_.begin() + address);
}

// [GigE Vision 2.0, chapter "Bootstrap registers"]
void CameraRegisters::fill_bootstrap() {
  in_addr address{};
  inet_pton(AF_INET, body_.address.c_str(), &address);
  const std::uint32_t ip = ntohl(address.s_addr);
  set_word(0x0000, 0x00020000);  // version 2.0
  set_word(0x0004, 0x80000001);  // big-endian, UTF-8
  set_word(0x0008, 0x00000200);  // MAC: locally administered, ending in the IP address
  set_word(0x000c, ip);
  set_word(0x0010, 0x80000007);  // can: persistent, DHCP, link-local
  set_word(0x0014, 0x00000005);  // is: persistent, link-local
  set_word(reg_current_ip, ip);
  set_word(0x0034, 0xff000000);
  set_text(0x0048, 32, "lightrig");
  set_text(0x0068, 32, "Simulated");
  set_text(0x0088, 32, "1");
  set_text(0x00a8, 48, "renders what the simulated lamp lights");
  set_text(0x00d8, 16, body_.serial);
  set_text(0x0200, 512,
           fmt::format("Local:lightrig.xml;{:X};{:X}", static_cast<std::uint32_t>(reg_genicam),
                       genicam_.size()));
  set_word(0x0600, 1);  // network interfaces
  set_word(0x0904, 1);  // stream channels
  // Can: write memory, packet resend, test data; has a serial number and a user name register.
  set_word(0x0934, 1U << 1 | 1U << 2 | 1U << 25 | 1U << 30 | 1U << 31);
  set_word(reg_heartbeat, 3000);
  set_word(0x0940, 1000000000);  // ticks are nanoseconds
  set_word(reg_packet_size, 1500);
}

void CameraRegisters::fill_features() {
  set_word(reg_width, static_cast<std::uint32_t>(body_.width));
  set_word(reg_height, static_cast<std::uint32_t>(body_.height));
  set_word(reg_sensor_width, static_cast<std::uint32_t>(body_.width));
  set_word(reg_sensor_height, static_cast<std::uint32_t>(body_.height));
  set_word(reg_pixel_format, offered_formats(body_.filter).front()->code);
  set_word(reg_acquisition_mode, continuous_mode);
  set_number(reg_exposure_time, std::clamp(0.01, body_.min_exposure, body_.max_exposure) * 1e6);
  set_number(reg_frame_rate, 10);
  set_number(reg_temperature, 25);
  set_number(reg_black_level, body_.black_level);
}

void CameraRegisters::load_default_user_set() {
  std::fill(memory_.begin() + reg_width, memory_.end(), std::uint8_t{0});
  fill_features();
}

std::uint32_t CameraRegisters::word(std::uint32_t address) const {
  return word_at(memory_, address);
}

void CameraRegisters::set_word(std::uint32_t address, std::uint32_t value) {
  for (std::uint32_t i = 0; i < 4; ++i)
    memory_[address + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

double CameraRegisters::number(std::uint32_t address) const {
  return std::bit_cast<double>(std::uint64_t{word(address)} << 32 | word(address + 4));
}

void CameraRegisters::set_number(std::uint32_t address, double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  set_word(address, static_cast<std::uint32_t>(bits >> 32));
  set_word(address + 4, static_cast<std::uint32_t>(bits));
}

GvStatus CameraRegisters::read(std::uint32_t address, std::span<std::uint8_t> into) const {
  if (address % 4 != 0 || into.size() % 4 != 0) return GvStatus::bad_alignment;
  if (address >= reg_genicam) {
    const std::size_t offset = address - reg_genicam;
    if (offset >= genicam_.size()) return GvStatus::invalid_address;
    // A client reads whole words; the last one may reach beyond the text.
    std::ranges::fill(into, std::uint8_t{0});
    const std::size_t length = std::min(into.size(), genicam_.size() - offset);
    std::copy_n(genicam_.begin() + static_cast<std::ptrdiff_t>(offset), length, into.begin());
    return GvStatus::ok;
  }
  if (address + into.size() > memory_.size()) return GvStatus::invalid_address;
  std::copy_n(memory_.begin() + address, into.size(), into.begin());
  if (address == reg_payload_size && into.size() == 4) {
    const std::uint32_t size = payload_size();
    for (std::size_t i = 0; i < 4; ++i) into[i] = static_cast<std::uint8_t>(size >> (24 - 8 * i));
  }
  return GvStatus::ok;
}

GvStatus CameraRegisters::accept_word(std::uint32_t address, std::uint32_t value) const {
  const auto allow = [](bool good) { return good ? GvStatus::ok : GvStatus::invalid_parameter; };
  switch (address) {
    case reg_width:
      return allow(value >= least_size && value + word(reg_offset_x) <= word(reg_sensor_width));
    case reg_height:
      return allow(value >= least_size && value + word(reg_offset_y) <= word(reg_sensor_height));
    case reg_offset_x:
      return allow(value <= word(reg_sensor_width) - word(reg_width));
    case reg_offset_y:
      return allow(value <= word(reg_sensor_height) - word(reg_height));
    case reg_pixel_format: {
      const auto formats = offered_formats(body_.filter);
      return allow(std::ranges::any_of(formats, [&](auto* f) { return f->code == value; }));
    }
    case reg_packet_size: {
      const std::uint32_t size = value & packet_size_mask;
      return allow(size >= least_packet && size <= most_packet && size % 4 == 0);
    }
    case reg_acquisition_mode:
      return allow(value == continuous_mode || value == single_frame_mode);
    case reg_trigger_source:
      return allow(value == software_source || value == line_source);
    case reg_trigger_mode:
    case reg_trigger_mode + 4:
    case reg_reverse_x:
    case reg_frame_rate_enable:
    case reg_chunk_mode:
    case reg_gamma_enable:
      return allow(value <= 1);
    default:
      return GvStatus::ok;
  }
}

GvStatus CameraRegisters::accept_number(std::uint32_t address, double value) const {
  double least = 0;
  double most = most_gain;
  if (address == reg_exposure_time) {
    least = body_.min_exposure * 1e6 * (1 - 1e-9);
    most = body_.max_exposure * 1e6 * (1 + 1e-9);
  } else if (address == reg_frame_rate) {
    least = least_frame_rate;
    most = most_frame_rate;
  } else if (address == reg_black_level) {
    most = (1 << body_.bits) - 1;
  }
  return value >= least && value <= most ? GvStatus::ok : GvStatus::invalid_parameter;
}

GvStatus CameraRegisters::write(std::uint32_t address, std::span<const std::uint8_t> bytes) {
  if (address % 4 != 0 || bytes.size() % 4 != 0) return GvStatus::bad_alignment;
  if (address + bytes.size() > memory_.size())
    return address >= reg_genicam ? GvStatus::write_protect : GvStatus::invalid_address;
  if (is_number(address)) {
    if (bytes.size() != 8) return GvStatus::invalid_parameter;
    const auto bits = std::uint64_t{word_at(bytes, 0)} << 32 | word_at(bytes, 4);
    const double value = std::bit_cast<double>(bits);
    const GvStatus status = accept_number(address, value);
    if (status == GvStatus::ok) set_number(address, value);
    return status;
  }
  if (std::ranges::find(writable, address) == std::end(writable)) return GvStatus::write_protect;
  if (bytes.size() != 4) return GvStatus::invalid_parameter;
  std::uint32_t value = word_at(bytes, 0);
  const GvStatus status = accept_word(address, value);
  if (status != GvStatus::ok) return status;
  if (address == reg_packet_size) value &= writable_packet_bits;
  if (address == reg_heartbeat) value = std::max(value, least_heartbeat_ms);
  set_word(address, value);
  return status;
}

std::uint32_t CameraRegisters::payload_size() const {
  const CaptureSettings now = settings();
  std::size_t size = payload_bytes(*now.format, now.width, now.height);
  if (now.chunk_mode) {
    size += chunk_tail_bytes;
    for (const bool enabled : now.chunks) size += enabled ? chunk_bytes + chunk_tail_bytes : 0;
  }
  return static_cast<std::uint32_t>(size);
}

CaptureSettings CameraRegisters::settings() const {
  CaptureSettings now;
  now.format = find_pixel_format(word(reg_pixel_format));
  now.exposure =
      std::clamp(number(reg_exposure_time) / 1e6, body_.min_exposure, body_.max_exposure);
  now.gain = number(reg_gain);
  now.black_level = number(reg_black_level);
  now.x = static_cast<int>(word(reg_offset_x));
  now.y = static_cast<int>(word(reg_offset_y));
  now.width = static_cast<int>(word(reg_width));
  now.height = static_cast<int>(word(reg_height));
  now.reverse_x = word(reg_reverse_x) == 1;
  now.single_frame = word(reg_acquisition_mode) == single_frame_mode;
  // Nobody here pulls the line that an acquisition's trigger waits for.
  const bool waits_for_line = word(reg_trigger_mode + 4) == 1;
  now.triggered = word(reg_trigger_mode) == 1 || waits_for_line;
  now.software_trigger =
      now.triggered && !waits_for_line && word(reg_trigger_source) == software_source;
  now.frame_period = word(reg_frame_rate_enable) == 1 ? 1 / number(reg_frame_rate) : 0;
  now.chunk_mode = word(reg_chunk_mode) == 1;
  for (std::size_t i = 0; i < chunk_count; ++i)
    now.chunks[i] = word(reg_chunk_enable + 4 * static_cast<std::uint32_t>(i)) != 0;
  return now;
}

std::vector<std::uint8_t> CameraRegisters::discovery() const {
  return {memory_.begin(), memory_.begin() + gvcp::discovery_bytes};
}

}  // namespace lightrig::sim
