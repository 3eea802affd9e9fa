#include "drivers/aravis/gv_preflight.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <fstream>
#include <string>
#include <system_error>

#include "drivers/aravis/gv_error.h"

namespace lightrig {
namespace {

constexpr int cap_net_raw = 13;  // <linux/capability.h>

/// What the kernel makes of a UDP receive buffer of so many bytes: its ceiling cuts one silently,
/// and then whole frames are lost. Asked of a socket, since /proc/sys may be hidden from a service,
/// and holds the numbers of another network than the process'.
Result<int> granted_receive_buffer(int wanted) {
  const int probe = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  int granted = 0;
  socklen_t size = sizeof granted;
  const bool asked = probe >= 0 &&
                     setsockopt(probe, SOL_SOCKET, SO_RCVBUF, &wanted, sizeof wanted) == 0 &&
                     getsockopt(probe, SOL_SOCKET, SO_RCVBUF, &granted, &size) == 0;
  const int why = errno;
  if (probe >= 0) close(probe);
  if (!asked)
    return fail(ErrorCode::refused,
                "ask for a UDP receive buffer: " + std::system_category().message(why));
  return granted / 2;  // the kernel doubles what it grants, for its own bookkeeping [socket(7)]
}

bool may_open_packet_sockets() {
  std::ifstream in("/proc/self/status");
  for (std::string word; in >> word;) {
    if (word != "CapEff:") continue;
    std::uint64_t capabilities = 0;
    in >> std::hex >> capabilities;
    return (capabilities >> cap_net_raw & 1) != 0;
  }
  return false;
}

}  // namespace

Result<void> check_receiving(const AravisCamera& backend) {
  if (backend.packet_socket) {
    // Without the capability Aravis would fall back to a small UDP buffer without a word.
    if (may_open_packet_sockets()) return {};
    return fail(ErrorCode::refused,
                "packet_socket = true needs CAP_NET_RAW, which this process has not: put "
                "AmbientCapabilities=CAP_NET_RAW into the unit of lightrigd (or `setcap "
                "cap_net_raw+ep` on the program), or set packet_socket = false");
  }
  const auto granted = granted_receive_buffer(backend.socket_buffer_bytes);
  if (!granted) return tl::unexpected(granted.error());
  if (*granted >= backend.socket_buffer_bytes) return {};
  return fail(ErrorCode::refused,
              fmt::format("the kernel allows UDP receive buffers of {} bytes, the rig file asks "
                          "for {}: frames would be lost; run `sysctl -w net.core.rmem_max={}`, or "
                          "set packet_socket = true and give lightrigd CAP_NET_RAW",
                          *granted, backend.socket_buffer_bytes, backend.socket_buffer_bytes));
}

Result<void> choose_packet_size(ArvCamera* camera, const AravisCamera& backend) {
  GError* error = nullptr;
  const bool can_test =
      arv_camera_is_feature_available(camera, "GevSCPSFireTestPacket", nullptr) != FALSE;
  const auto carried = static_cast<int>(arv_camera_gv_auto_packet_size(camera, &error));
  if (error) return gv_fail("negotiate the packet size", error);
  if (backend.packet_size == 0) return {};
  if (can_test && carried < backend.packet_size)
    return fail(ErrorCode::refused,
                fmt::format("packet_size_bytes = {}, but the largest packet that arrives from the "
                            "camera has {} bytes: raise the MTU of the network card and of every "
                            "switch on the way (`ip link set DEVICE mtu 9000`), or leave the key "
                            "out to have the size negotiated",
                            backend.packet_size, carried));
  arv_camera_gv_set_packet_size(camera, backend.packet_size, &error);
  if (error) return gv_fail("set the packet size", error);
  const auto now = static_cast<int>(arv_camera_gv_get_packet_size(camera, &error));
  if (error) return gv_fail("read the packet size back", error);
  if (now != backend.packet_size)
    return fail(ErrorCode::refused, fmt::format("asked for packets of {} bytes, but the camera "
                                                "says {}: it can do only some sizes",
                                                backend.packet_size, now));
  return {};
}

}  // namespace lightrig
