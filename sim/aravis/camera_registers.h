#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/pixel_format.h"
#include "sim/aravis/gv_packets.h"

namespace lightrig::sim {

/// What makes one simulated camera differ from another.
struct CameraBody {
  std::string address = "127.0.0.1";  ///< IPv4 of this host that the camera answers at
  std::string serial = "SIM1";        ///< at most 15 letters
  int width = 0, height = 0;          ///< [px] of the sensor; a frame is all of it or a part
  ColorFilter filter = ColorFilter::mono;
  int bits = 12;                              ///< of the sensor's counts
  double black_level = 0;                     ///< [DN] of those counts
  double min_exposure = 0, max_exposure = 0;  ///< [s]
  double readout_time = 0;                    ///< [s] from the end of the exposure to the transfer
  double link_rate = 125e6;  ///< [byte/s] of the camera's link: gigabit Ethernet; 0 sends at once
};

/// Addresses of the registers that do something. Below 0xa000 they are GigE Vision's bootstrap
/// registers, above them this camera's own, which its GenICam description names.
enum Register : std::uint32_t {
  reg_current_ip = 0x0024,
  reg_heartbeat = 0x0938,  ///< [ms]
  reg_timestamp_control = 0x0944,
  reg_timestamp_high = 0x0948,
  reg_timestamp_low = 0x094c,
  reg_privilege = 0x0a00,
  reg_stream_port = 0x0d00,
  reg_packet_size = 0x0d04,   ///< and the flags beside it
  reg_packet_delay = 0x0d08,  ///< [ticks]
  reg_stream_destination = 0x0d18,
  reg_stream_source_port = 0x0d1c,

  reg_width = 0xa000,
  reg_height = 0xa004,
  reg_sensor_width = 0xa008,
  reg_sensor_height = 0xa00c,
  reg_pixel_format = 0xa010,
  reg_payload_size = 0xa014,
  reg_acquisition_mode = 0xa018,
  reg_acquisition_start = 0xa01c,
  reg_acquisition_stop = 0xa020,
  reg_trigger_source = 0xa028,
  reg_trigger_software = 0xa02c,
  reg_frame_rate_enable = 0xa030,
  reg_device_reset = 0xa034,
  reg_chunk_mode = 0xa038,
  reg_gamma_enable = 0xa03c,
  reg_chunk_enable = 0xa040,  ///< one word per chunk, in the order of Chunk
  reg_offset_x = 0xa054,
  reg_offset_y = 0xa058,
  reg_reverse_x = 0xa05c,
  reg_user_set_load = 0xa060,
  reg_trigger_mode = 0xa064,   ///< one word per trigger: a frame's, then an acquisition's
  reg_exposure_time = 0xa080,  ///< [us], double
  reg_gain = 0xa088,           ///< [dB], double
  reg_frame_rate = 0xa090,     ///< [Hz], double
  reg_temperature = 0xa098,    ///< [°C], double
  reg_black_level = 0xa0a0,    ///< [DN] of the sensor's counts, double
  reg_genicam = 0x100000,
};

/// What may follow an image, and its id in the trailer.
enum class Chunk : std::uint8_t { frame_id, exposure_time, timestamp, offset_x, offset_y };
constexpr std::size_t chunk_count = 5;
constexpr std::uint32_t chunk_id(Chunk chunk) {
  return 0xc0de0001U + static_cast<std::uint32_t>(chunk);
}
constexpr std::uint32_t image_chunk_id = 0xc0de0000U;

constexpr std::uint32_t continuous_mode = 1, single_frame_mode = 2;
constexpr std::uint32_t software_source = 0, line_source = 1;
constexpr double most_gain = 24;  ///< [dB]
constexpr int least_size = 8;     ///< [px] of a picture's sides
constexpr double least_frame_rate = 0.1, most_frame_rate = 1000;

/// How the next frame is to be taken, as the registers say.
struct CaptureSettings {
  const PixelFormat* format = nullptr;
  double exposure = 0;                      ///< [s]
  double gain = 0;                          ///< [dB]
  double black_level = 0;                   ///< [DN] of the sensor's counts
  int x = 0, y = 0, width = 0, height = 0;  ///< [px] the part of the sensor that is sent
  bool reverse_x = false;                   ///< mirrored left to right
  bool single_frame = false;
  bool triggered = false, software_trigger = false;
  double frame_period = 0;  ///< [s] 0: as fast as it can
  std::array<bool, chunk_count> chunks{};
  bool chunk_mode = false;
};

/// The camera's memory: what may be read and written where, and what is refused with which status.
/// What a write sets in motion is the camera's business. Not safe from several threads.
class CameraRegisters {
 public:
  explicit CameraRegisters(const CameraBody& body);

  GvStatus read(std::uint32_t address, std::span<std::uint8_t> into) const;
  GvStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes);

  std::uint32_t word(std::uint32_t address) const;
  void set_word(std::uint32_t address, std::uint32_t value);
  /// Every feature as at power-on; control and stream channel stay as they are.
  void load_default_user_set();
  CaptureSettings settings() const;
  std::vector<std::uint8_t> discovery() const;

 private:
  void fill_bootstrap();
  void fill_features();
  void set_text(std::uint32_t address, std::size_t room, const std::string& text);
  double number(std::uint32_t address) const;
  void set_number(std::uint32_t address, double value);
  GvStatus accept_word(std::uint32_t address, std::uint32_t value) const;
  GvStatus accept_number(std::uint32_t address, double value) const;
  std::uint32_t payload_size() const;

  CameraBody body_;
  std::string genicam_;
  std::vector<std::uint8_t> memory_;
};

}  // namespace lightrig::sim
