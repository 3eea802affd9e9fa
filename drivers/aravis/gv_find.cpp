#include "drivers/aravis/gv_find.h"

#include <fmt/format.h>

#include <vector>

#include "drivers/aravis/gv_error.h"
#include "drivers/aravis/gv_preflight.h"
#include "drivers/devices.h"

namespace lightrig {
namespace {

constexpr int gvcp_port = 3956;

GRef<GInetAddress> ipv4(const std::string& text) {
  GRef<GInetAddress> address(g_inet_address_new_from_string(text.c_str()));
  if (address && g_inet_address_get_family(address.get()) != G_SOCKET_FAMILY_IPV4) address.reset();
  return address;
}

tl::unexpected<Error> not_there(GError* error) {
  auto failure = gv_fail("open", error);
  failure.value().message +=
      "; check power, cable and subnet, and `lightrig devices`; by IP address discovery is not "
      "needed";
  if (failure.value().code == ErrorCode::refused) failure.value().code = ErrorCode::not_found;
  return failure;
}

/// A camera at an address, through one of the host's networks.
Result<GRef<ArvCamera>> open_through(GInetAddress* host, GInetAddress* device) {
  GError* error = nullptr;
  const GRef<ArvDevice> opened(arv_gv_device_new(host, device, &error));
  if (!opened || error) return not_there(error);
  GRef<ArvCamera> camera(arv_camera_new_with_device(opened.get(), &error));
  if (!camera) return not_there(error);
  return camera;
}

Result<GRef<ArvCamera>> open_known(const std::string& id) {
  GError* error = nullptr;
  GRef<ArvCamera> camera(arv_camera_new(id.empty() ? nullptr : id.c_str(), &error));
  if (!camera) return not_there(error);
  return camera;
}

std::vector<FoundCamera> discover() {
  const auto copy = [](const char* text) { return std::string(text ? text : ""); };
  arv_update_device_list();
  std::vector<FoundCamera> cameras;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
    if (copy(arv_get_device_protocol(i)) != "GigEVision") continue;
    cameras.push_back({copy(arv_get_device_id(i)), copy(arv_get_device_address(i)),
                       copy(arv_get_device_serial_nbr(i)), copy(arv_get_device_physical_id(i)),
                       ""});
  }
  return cameras;
}

std::string list_of(const std::vector<FoundCamera>& cameras) {
  std::string text;
  for (const FoundCamera& camera : cameras)
    text += fmt::format("{}{} at {}", text.empty() ? "" : ", ", camera.id, camera.address);
  return text.empty() ? "none" : text;
}

}  // namespace

Result<GRef<ArvCamera>> find_camera(const AravisCamera& backend) {
  if (backend.port != gvcp_port)
    return fail(ErrorCode::invalid_input,
                fmt::format("[camera.aravis] port = {}: GigE Vision cameras listen at {}, and "
                            "Aravis asks nowhere else; leave the key out",
                            backend.port, gvcp_port));
  const GRef<GInetAddress> host = ipv4(backend.interface_ip);
  if (!backend.interface_ip.empty() && !host)
    return fail(ErrorCode::invalid_input,
                fmt::format("[camera.aravis] interface_ip = \"{}\" is not an IPv4 address",
                            backend.interface_ip));
  if (const GRef<GInetAddress> device = ipv4(backend.id))
    return host ? open_through(host.get(), device.get()) : open_known(backend.id);
  if (backend.id.empty()) return open_known("");
  const std::vector<FoundCamera> all = discover();
  std::vector<FoundCamera> fitting;
  for (const FoundCamera& camera : all)
    if (camera.id == backend.id || camera.serial == backend.id ||
        camera.hardware_address == backend.id)
      fitting.push_back(camera);
  if (fitting.empty())
    return fail(ErrorCode::not_found,
                fmt::format("no camera on the network is \"{}\"; there are: {}; check power, cable "
                            "and subnet, and `lightrig devices`; by IP address discovery is not "
                            "needed",
                            backend.id, list_of(all)));
  if (fitting.size() > 1)
    return fail(ErrorCode::refused, fmt::format("\"{}\" fits several cameras: {}; give the address",
                                                backend.id, list_of(fitting)));
  if (!host) return open_known(fitting.front().id);
  const GRef<GInetAddress> device = ipv4(fitting.front().address);
  return open_through(host.get(), device.get());
}

Result<std::vector<FoundCamera>> find_cameras() {
  std::vector<FoundCamera> cameras = discover();
  const auto receiving = check_receiving(AravisCamera{});
  for (FoundCamera& camera : cameras)
    if (!receiving) camera.obstacle = receiving.error().message;
  return cameras;
}

}  // namespace lightrig
