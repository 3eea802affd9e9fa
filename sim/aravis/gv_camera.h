#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "sim/aravis/acquisition.h"
#include "sim/aravis/camera_registers.h"
#include "sim/aravis/gvsp_stream.h"
#include "sim/camera_wire_faults.h"

namespace lightrig::sim {

/// A GigE Vision camera at the far end of a network: discovery, control privilege with a heartbeat,
/// registers and memory, packet resend, test packets, stream. Its protocol keeps real time; its
/// exposures keep the clock's.
class GvCamera {
 public:
  /// Errors: refused (the address is not this machine's, or another camera answers there),
  /// invalid_input (not an IPv4 address).
  static Result<std::unique_ptr<GvCamera>> open(const CameraBody& body, Sensor sensor, Clock& clock,
                                                std::shared_ptr<CameraWireFaults> faults);
  ~GvCamera();
  GvCamera(const GvCamera&) = delete;
  GvCamera& operator=(const GvCamera&) = delete;

 private:
  using Instant = std::chrono::steady_clock::time_point;
  struct Peer {
    std::uint32_t address = 0;
    std::uint16_t port = 0;
    bool operator==(const Peer&) const = default;
  };

  GvCamera(const CameraBody& body, std::shared_ptr<CameraWireFaults> faults);
  Result<void> bind_sockets();
  void serve(const std::stop_token& stop);
  void receive(int socket);
  std::optional<Packet> answer(const gvcp::Command& command, const Peer& from);
  Packet answer_read_registers(const gvcp::Command& command) const;
  Packet answer_write_registers(const gvcp::Command& command, const Peer& from);
  Packet answer_read_memory(const gvcp::Command& command) const;
  Packet answer_write_memory(const gvcp::Command& command, const Peer& from);
  GvStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes, const Peer& from);
  GvStatus write_privilege(std::uint32_t value, const Peer& from);
  void act_on(std::uint32_t address, std::uint32_t value);
  void release_control();
  void drop_dead_controller();
  StreamTarget target() const;
  std::uint64_t timestamp() const;
  Shot next_shot();
  void befall(const CameraFault& fault);
  void reboot(double deaf_seconds);

  const CameraBody body_;
  const std::shared_ptr<CameraWireFaults> faults_;
  int control_ = -1, broadcast_ = -1;

  mutable std::mutex mutex_;  // guards what follows, up to the parts with locks of their own
  CameraRegisters registers_;
  std::optional<Peer> controller_;
  Instant heard_;         // from the controller
  Instant deaf_until_;    // frozen, or booting
  Instant stolen_until_;  // control is in other hands
  Instant booted_;

  std::unique_ptr<GvspStream> stream_;
  std::unique_ptr<Acquisition> acquisition_;
  std::jthread thread_;  // last
};

}  // namespace lightrig::sim
