// The camera of a rig file, hosted.
#include <arpa/inet.h>

#include "sim/aravis/gv_camera.h"
#include "sim/hosted_wire.h"
#include "sim/world.h"

namespace lightrig::sim {
namespace {

bool is_ipv4(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

/// The address a driver would find this camera at: the id, where it is one; else the network the
/// rig file names, or loopback, with the id as the serial number to be discovered by.
CameraBody body_of(const Rig& rig, const AravisCamera& backend) {
  CameraBody body;
  if (is_ipv4(backend.id)) {
    body.address = backend.id;
  } else {
    if (is_ipv4(backend.interface_ip)) body.address = backend.interface_ip;
    // Aravis' id is "Vendor-Model-Serial"; a serial number alone will do too.
    const std::size_t dash = backend.id.rfind('-');
    const std::string serial = dash == std::string::npos ? backend.id : backend.id.substr(dash + 1);
    if (!serial.empty()) body.serial = serial;
  }
  const SensorModel& sensor = rig.camera.sensor;
  body.width = rig.camera.model.width;
  body.height = rig.camera.model.height;
  body.filter = sensor.filter;
  body.bits = sensor.bits;
  body.black_level = sensor.black_level;
  body.min_exposure = sensor.min_exposure;
  body.max_exposure = sensor.max_exposure;
  body.readout_time = rig.camera.readout_time;
  return body;
}

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig& rig, const AravisCamera& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<CameraWireFaults> faults) {
  const CameraBody body = body_of(rig, backend);
  World& scene = *world;
  // The camera holds the world for as long as it may look at it.
  Sensor sensor = [world = std::move(world)](double exposure, const std::stop_token& stop) {
    return world->expose(world->look(), exposure, stop);
  };
  auto camera = GvCamera::open(body, std::move(sensor), scene.clock(), std::move(faults));
  if (!camera) return tl::unexpected(with_context("simulate the camera", camera.error()));
  std::shared_ptr<GvCamera> shared = std::move(*camera);
  return std::vector<HostedWire>{{"camera", body.address, shared, {}, {}}};
}

}  // namespace lightrig::sim
