#include "daemon/service/device_claims.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <set>
#include <variant>

namespace lightrig {
namespace {

std::string text_of(const TcpEndpoint& tcp) {
  std::string host = tcp.host;
  std::ranges::transform(host, host.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  return fmt::format("modbus {}:{}", host, tcp.port);
}

std::string text_of(const SerialEndpoint& serial) {
  std::error_code error;
  const auto real = std::filesystem::weakly_canonical(serial.device, error);
  return "serial " + (error ? serial.device : real.string());
}

std::string text_of(const UsbEndpoint& usb) {
  return fmt::format("usb {:04x}:{:04x} {}", usb.vendor, usb.product, usb.serial);
}

struct Collect {
  std::set<std::string>& all;

  template <class... Endpoints>
  void add(const std::variant<Endpoints...>& endpoint) const {
    std::visit([this](const auto& one) { all.insert(text_of(one)); }, endpoint);
  }
  void operator()(const AravisCamera& camera) const { all.insert("camera " + camera.id); }
  void operator()(const ModbusGantry& gantry) const {
    for (const ModbusDrive& drive : gantry.drives) add(drive.endpoint);
  }
  void operator()(const GrblGantry& gantry) const { add(gantry.endpoint); }
  void operator()(const ModbusLamp& lamp) const { add(lamp.endpoint); }
  void operator()(const GrblLamp& lamp) const { add(lamp.endpoint); }
  // In memory, or on another one's wire.
  void operator()(const SimulatedCamera&) const {}
  void operator()(const SimulatedGantry&) const {}
  void operator()(const FixedLampsGantry&) const {}
  void operator()(const SimulatedLamp&) const {}
  void operator()(const GantryLamp&) const {}
};

struct Name {
  sockaddr_un address{};
  socklen_t size = 0;
};

Name name_of(const std::string& endpoint) {
  Name name;
  name.address.sun_family = AF_UNIX;
  std::string text = "lightrig " + endpoint;
  const std::size_t most = sizeof(name.address.sun_path) - 1;
  if (text.size() > most) text = text.substr(text.size() - most);
  text.copy(name.address.sun_path + 1, most);
  name.size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + text.size());
  return name;
}

const sockaddr* as_sockaddr(const void* address) { return static_cast<const sockaddr*>(address); }

// "process 4711", as the kernel knows it.
std::string holder_of(const Name& name) {
  const FileDescriptor fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  ucred who{};
  socklen_t size = sizeof who;
  if (connect(fd.get(), as_sockaddr(&name.address), name.size) != 0 ||
      getsockopt(fd.get(), SOL_SOCKET, SO_PEERCRED, &who, &size) != 0)
    return "another process";
  return fmt::format("process {}", who.pid);
}

}  // namespace

std::vector<std::string> endpoints_of(const Rig& rig) {
  std::set<std::string> all;
  const Collect collect{all};
  std::visit(collect, rig.gantry.backend);
  std::visit(collect, rig.lamp.backend);
  std::visit(collect, rig.camera.backend);
  return {all.begin(), all.end()};
}

Result<DeviceClaims> DeviceClaims::take(const Rig& rig) {
  DeviceClaims claims;
  for (const std::string& endpoint : endpoints_of(rig)) {
    const Name name = name_of(endpoint);
    FileDescriptor fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    if (bind(fd.get(), as_sockaddr(&name.address), name.size) != 0)
      return fail(ErrorCode::refused,
                  errno == EADDRINUSE
                      ? fmt::format("{} is in use by another lightrigd ({}), whatever its rig file "
                                    "is called; stop it first: two hands on one gantry collide",
                                    endpoint, holder_of(name))
                      : fmt::format("cannot claim {}: {}", endpoint, std::strerror(errno)));
    (void)listen(fd.get(), 64);  // only so that holder_of() can ask
    claims.held_.push_back(std::move(fd));
  }
  return claims;
}

}  // namespace lightrig
