#include "drivers/aravis/gv_preflight.h"

#include <fmt/format.h>

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>

#include "drivers/aravis/gv_error.h"

namespace lightrig {
namespace {

constexpr int cap_net_raw = 13;  // <linux/capability.h>

/// The kernel's ceiling on UDP receive buffers; a smaller one silently cuts ours and loses whole
/// frames.
std::optional<long> kernel_receive_limit() {
  std::ifstream in("/proc/sys/net/core/rmem_max");
  long limit = 0;
  if (in >> limit) return limit;
  return std::nullopt;
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
  const auto limit = kernel_receive_limit();
  if (!limit || *limit >= backend.socket_buffer_bytes) return {};
  return fail(ErrorCode::refused,
              fmt::format("the kernel allows UDP receive buffers of {} bytes, the rig file asks "
                          "for {}: frames would be lost; run `sysctl -w net.core.rmem_max={}`, or "
                          "set packet_socket = true and give lightrigd CAP_NET_RAW",
                          *limit, backend.socket_buffer_bytes, backend.socket_buffer_bytes));
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
