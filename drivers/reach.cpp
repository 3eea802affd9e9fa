#include "drivers/reach.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <set>
#include <type_traits>
#include <variant>

#include "config/file_descriptor.h"
#include "drivers/backends.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using SteadyClock = std::chrono::steady_clock;

// GigE Vision's control protocol [GigE Vision 2.0, ch. 15]: a discovery command with the flags
// "answer, by broadcast if need be", and where its answer holds what.
constexpr std::array<std::uint8_t, 8> discovery_command{0x42, 0x11, 0, 2, 0, 0, 0, 1};
constexpr std::size_t header_bytes = 8, answer_bytes = 248;
constexpr std::size_t mac_at = 10, vendor_at = 72, model_at = 104, serial_at = 216;

struct DiscoveryAnswer {
  std::string address, vendor, model, serial, mac;
};

sockaddr_in ipv4(in_addr_t address, int port) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = address;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  return to;
}
const sockaddr* raw(const sockaddr_in& address) {
  const void* any = &address;
  return static_cast<const sockaddr*>(any);
}

std::string text_at(const std::uint8_t* bytes, std::size_t at, std::size_t most) {
  std::string text;
  for (std::size_t i = at; i < at + most && bytes[i] >= 0x20 && bytes[i] < 0x7f; ++i)
    text += static_cast<char>(bytes[i]);
  return text;
}

std::optional<DiscoveryAnswer> answer_of(const std::uint8_t* datagram, std::size_t size,
                                         in_addr from) {
  // Status 0, command "discovery answered", as long as it must be.
  if (size < header_bytes + answer_bytes || datagram[0] != 0 || datagram[1] != 0 ||
      datagram[2] != 0 || datagram[3] != 3)
    return {};
  const std::uint8_t* body = datagram + header_bytes;
  std::array<char, INET_ADDRSTRLEN> text{};
  inet_ntop(AF_INET, &from, text.data(), text.size());
  return DiscoveryAnswer{
      text.data(), text_at(body, vendor_at, 32), text_at(body, model_at, 32),
      text_at(body, serial_at, 16),
      fmt::format("{:02x}:{:02x}:{:02x}:{:02x}:{:02x}:{:02x}", body[mac_at], body[mac_at + 1],
                  body[mac_at + 2], body[mac_at + 3], body[mac_at + 4], body[mac_at + 5])};
}

/// Addresses of this host's networks that are up; of `only` alone where that is not "".
std::vector<in_addr_t> own_addresses(const std::string& only) {
  std::vector<in_addr_t> all;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return all;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  in_addr wanted{};
  const bool one = inet_pton(AF_INET, only.c_str(), &wanted) == 1;
  for (const ifaddrs* it = list; it != nullptr; it = it->ifa_next) {
    if (it->ifa_addr == nullptr || it->ifa_addr->sa_family != AF_INET ||
        (it->ifa_flags & IFF_UP) == 0)
      continue;
    const void* any = it->ifa_addr;
    const in_addr_t address = static_cast<const sockaddr_in*>(any)->sin_addr.s_addr;
    if (!one || address == wanted.s_addr) all.push_back(address);
  }
  return all;
}

bool is_meant(const AravisCamera& camera, const DiscoveryAnswer& answer) {
  // Aravis' id is vendor, model and serial number, or vendor and serial number.
  return camera.id.empty() || camera.id == answer.address || camera.id == answer.serial ||
         camera.id == answer.mac ||
         (!answer.serial.empty() && camera.id.ends_with("-" + answer.serial));
}

std::optional<DiscoveryAnswer> ask_camera(const AravisCamera& camera,
                                          std::chrono::milliseconds patience) {
  in_addr device{};
  const bool known = inet_pton(AF_INET, camera.id.c_str(), &device) == 1;
  std::vector<FileDescriptor> sockets;
  std::vector<in_addr_t> hosts = own_addresses(camera.interface_ip);
  if (known) hosts = {INADDR_ANY};
  for (const in_addr_t host : hosts) {
    FileDescriptor fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    const int yes = 1;
    const sockaddr_in here = ipv4(host, 0),
                      there = ipv4(known ? device.s_addr : INADDR_BROADCAST, camera.port);
    if (!fd.valid() || bind(fd.get(), raw(here), sizeof here) != 0 ||
        setsockopt(fd.get(), SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes) != 0 ||
        sendto(fd.get(), discovery_command.data(), discovery_command.size(), 0, raw(there),
               sizeof there) < 0)
      continue;
    sockets.push_back(std::move(fd));
  }
  const auto end = SteadyClock::now() + patience;
  while (!sockets.empty()) {
    std::vector<pollfd> waiting;
    for (const FileDescriptor& fd : sockets) waiting.push_back({fd.get(), POLLIN, 0});
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(end - SteadyClock::now());
    if (left.count() <= 0) return {};
    const int ready = poll(waiting.data(), waiting.size(), static_cast<int>(left.count()));
    if (ready < 0 && errno == EINTR) continue;
    if (ready <= 0) return {};
    for (const pollfd& one : waiting) {
      if (one.revents == 0) continue;
      std::array<std::uint8_t, 1024> datagram{};
      sockaddr_in from{};
      socklen_t size = sizeof from;
      void* any = &from;
      const ssize_t n =
          recvfrom(one.fd, datagram.data(), datagram.size(), 0, static_cast<sockaddr*>(any), &size);
      // A closed port answers with an error: nobody is a camera there.
      if (n < 0 && known) return {};
      if (n < 0) continue;
      auto answer = answer_of(datagram.data(), static_cast<std::size_t>(n), from.sin_addr);
      if (answer && is_meant(camera, *answer)) return answer;
    }
  }
  return {};
}

Reach look_for(const AravisCamera& camera, std::chrono::milliseconds patience) {
  const std::string device = "camera " + (camera.id.empty() ? "(any)" : camera.id);
  auto answer = ask_camera(camera, patience);
  if (!answer) answer = ask_camera(camera, patience);  // one datagram may be lost
  if (!answer)
    return {device, false,
            fmt::format("it does not answer discovery within {} ms; check power, cable and subnet, "
                        "and `lightrig devices`",
                        patience.count())};
  return {device, true,
          fmt::format("{} {} serial {} answers discovery at {}", answer->vendor, answer->model,
                      answer->serial, answer->address)};
}

/// Of a node of /dev: whether it is there, and this user's to open.
Reach look_for_node(const std::string& device, const fs::path& node, const char* group) {
  if (access(node.c_str(), R_OK | W_OK) == 0) return {device, true, "it is plugged in"};
  const std::string why = std::strerror(errno);
  return {device, false,
          errno == EACCES
              ? fmt::format("no permission for {}: add the user to group {}", node.string(), group)
              : fmt::format("{}: {}; plug it in, check its cable and power", node.string(), why)};
}

std::string first_line(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

Reach look_for(const SerialEndpoint& serial) {
  return look_for_node("serial " + serial.device, serial.device, "dialout");
}

Reach look_for(const UsbEndpoint& usb) {
  const std::string vendor = fmt::format("{:04x}", usb.vendor),
                    product = fmt::format("{:04x}", usb.product);
  const std::string device = fmt::format("usb {}:{}{}{}", vendor, product,
                                         usb.serial.empty() ? "" : " serial ", usb.serial);
  std::error_code error;
  // Not by a range: what is unplugged meanwhile would throw.
  for (fs::directory_iterator entry("/sys/bus/usb/devices", error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& at = entry->path();
    if (first_line(at / "idVendor") != vendor || first_line(at / "idProduct") != product ||
        (!usb.serial.empty() && first_line(at / "serial") != usb.serial))
      continue;
    return look_for_node(device,
                         fmt::format("/dev/bus/usb/{:0>3}/{:0>3}", first_line(at / "busnum"),
                                     first_line(at / "devnum")),
                         "plugdev (the shipped udev rule does it)");
  }
  return {device, false, "the system lists no such device; plug it in, check its cable and power"};
}

struct ReachLook {
  std::chrono::milliseconds patience;
  std::vector<Reach>& found;
  std::set<std::string> known = {};

  void add(Reach one) {
    if (known.insert(one.device).second) found.push_back(std::move(one));
  }
  template <class... Endpoints>
  void add(const std::variant<Endpoints...>& endpoint) {
    if (const auto* serial = std::get_if<SerialEndpoint>(&endpoint)) add(look_for(*serial));
    if constexpr ((std::is_same_v<Endpoints, UsbEndpoint> || ...))
      if (const auto* usb = std::get_if<UsbEndpoint>(&endpoint)) add(look_for(*usb));
  }
  void operator()(const AravisCamera& camera) { add(look_for(camera, patience)); }
  void operator()(const ModbusGantry& gantry) {
    for (const ModbusDrive& drive : gantry.drives) add(drive.endpoint);
  }
  void operator()(const GrblGantry& gantry) { add(gantry.endpoint); }
  void operator()(const ModbusLamp& lamp) { add(lamp.endpoint); }
  void operator()(const GrblLamp& lamp) { add(lamp.endpoint); }
  // In memory, or on another one's wire.
  void operator()(const SimulatedCamera&) {}
  void operator()(const SimulatedGantry&) {}
  void operator()(const FixedLampsGantry&) {}
  void operator()(const SimulatedLamp&) {}
  void operator()(const GantryLamp&) {}
};

}  // namespace

std::vector<Reach> reach_of(const Rig& rig, std::chrono::milliseconds patience) {
  std::vector<Reach> found;
  const std::vector<std::string> named = backends_named_by(rig);
  for (const Backend& backend : backends())
    if (!backend.built && std::ranges::find(named, backend.name) != named.end())
      found.push_back({"backend " + backend.name, false, backend.remedy});
  ReachLook look{patience, found};
  const auto visit = [&](const auto& backend) {
    std::visit([&](const auto& b) { look(b); }, backend);
  };
  visit(rig.gantry.backend);
  visit(rig.lamp.backend);
  visit(rig.camera.backend);
  return found;
}

}  // namespace lightrig
