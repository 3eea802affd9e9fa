#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <set>
#include <stop_token>
#include <vector>

#include "core/result.h"
#include "sim/aravis/gv_packets.h"
#include "sim/camera_wire_faults.h"

namespace lightrig::sim {

/// Where the stream goes and how.
struct StreamTarget {
  std::uint32_t address = 0;         ///< IPv4, host order
  std::uint16_t port = 0;            ///< 0: the stream is closed
  std::uint32_t packet_size = 1500;  ///< [byte] with IP, UDP and GVSP headers
  std::uint64_t packet_delay = 0;    ///< [ns] between packets
  bool do_not_fragment = false;
};

/// One frame as it goes over the wire.
struct WireFrame {
  gvsp::ImageFacts facts;
  std::vector<std::uint8_t> data;  ///< image, and chunks behind it
};

/// The stream channel: frames cut into packets at the pace of the link, and the last few of them
/// kept, to be sent again packet by packet. Safe from several threads.
class GvspStream {
 public:
  /// `link_rate` [byte/s]: 0 sends as fast as the socket takes it.
  static Result<std::unique_ptr<GvspStream>> open(const std::string& address, double link_rate);
  ~GvspStream();
  GvspStream(const GvspStream&) = delete;
  GvspStream& operator=(const GvspStream&) = delete;

  std::uint16_t source_port() const { return source_port_; }

  void send(WireFrame frame, const StreamTarget& target, const std::vector<CameraFault>& struck,
            CameraWireFaults& faults, const std::stop_token& stop);
  /// Packets first … last of a block once more; those that cannot be had are said to be
  /// unavailable.
  void resend(std::uint16_t block, std::uint32_t first, std::uint32_t last,
              const StreamTarget& target, CameraWireFaults& faults);
  /// A packet of exactly the size set, for the client to find the largest that arrives.
  void send_test_packet(const StreamTarget& target);
  /// Block numbers begin anew, nothing is kept.
  void restart();

 private:
  struct Sent {
    std::uint16_t block = 0;
    std::shared_ptr<const WireFrame> frame;
    std::size_t slice = 0;             ///< payload bytes of a packet
    std::uint32_t payloads = 0;        ///< the trailer is packet payloads + 1
    std::set<std::uint32_t> gone;      ///< packets that cannot be sent again
    std::set<std::uint32_t> withheld;  ///< packets lost on the way
  };

  GvspStream() = default;
  void transmit(const Packet& header, std::span<const std::uint8_t> body,
                const StreamTarget& target) const;
  void send_packet(const Sent& sent, std::uint32_t packet, std::uint16_t status,
                   const StreamTarget& target) const;
  Sent remember(WireFrame frame, const StreamTarget& target,
                const std::vector<CameraFault>& struck);

  int socket_ = -1;
  std::uint16_t source_port_ = 0;
  double link_rate_ = 0;
  std::mutex mutex_;
  std::uint16_t block_ = 0;
  std::deque<Sent> history_;
};

}  // namespace lightrig::sim
