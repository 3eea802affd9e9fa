#include <algorithm>
#include <variant>

#include "drivers/backends.h"
#include "drivers/devices.h"

namespace lightrig {
namespace {

tl::unexpected<Error> only_in_memory(const char* part) {
  return fail(ErrorCode::refused,
              std::string("the rig file gives the ") + part +
                  " no backend: it exists only in memory; start the service with --simulate, or "
                  "name the hardware in the rig file");
}

// The overloads for parts that exist only in memory stand here, beside the dispatch.
Result<GantryAndLamp> open_gantry(const Rig&, const SimulatedGantry&, Clock&) {
  return only_in_memory("gantry");
}
Result<std::unique_ptr<Camera>> open_camera(const Rig&, const SimulatedCamera&, Clock&) {
  return only_in_memory("camera");
}
Result<std::unique_ptr<Lamp>> open_lamp(const Rig&, const SimulatedLamp&, Clock&) {
  return only_in_memory("lamp");
}
Result<std::unique_ptr<Lamp>> open_lamp(const Rig&, const GantryLamp&, Clock&) {
  return fail(
      ErrorCode::refused,
      "the lamp hangs on the gantry's controller, but this gantry's driver offers no outputs");
}

}  // namespace

Result<Devices> open_devices(const Rig& rig, Clock& clock) {
  Devices devices;
  auto gantry = std::visit([&](const auto& backend) { return open_gantry(rig, backend, clock); },
                           rig.gantry.backend);
  if (!gantry) return tl::unexpected(with_context("open gantry", gantry.error()));
  devices.gantry = std::move(gantry->gantry);
  devices.lamp = std::move(gantry->lamp);
  if (!devices.lamp) {
    auto lamp = std::visit([&](const auto& backend) { return open_lamp(rig, backend, clock); },
                           rig.lamp.backend);
    if (!lamp) return tl::unexpected(with_context("open lamp", lamp.error()));
    devices.lamp = std::move(*lamp);
  }
  auto camera = std::visit([&](const auto& backend) { return open_camera(rig, backend, clock); },
                           rig.camera.backend);
  if (!camera) return tl::unexpected(with_context("open camera", camera.error()));
  devices.camera = std::move(*camera);
  return devices;
}

std::vector<std::string> backends_named_by(const Rig& rig) {
  std::vector<std::string> names;
  if (std::holds_alternative<ModbusGantry>(rig.gantry.backend) ||
      std::holds_alternative<ModbusLamp>(rig.lamp.backend))
    names.emplace_back("modbus");
  if (std::holds_alternative<GrblGantry>(rig.gantry.backend)) names.emplace_back("usb");
  if (std::holds_alternative<AravisCamera>(rig.camera.backend)) names.emplace_back("aravis");
  return names;
}

std::vector<std::string> drivers_not_opened(const Rig& rig, bool simulated) {
  const std::vector<std::string> named = backends_named_by(rig);
  std::vector<std::string> names;
  for (const Backend& backend : backends())
    if (simulated || std::find(named.begin(), named.end(), backend.name) == named.end())
      names.push_back(backend.name);
  return names;
}

std::vector<Backend> backends() { return {modbus_backend(), usb_backend(), aravis_backend()}; }

}  // namespace lightrig
