#include <algorithm>
#include <chrono>
#include <variant>

#include "drivers/backends.h"
#include "drivers/devices.h"
#include "drivers/make_safe.h"

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
  auto camera = open_camera(rig, clock);
  if (!camera) return tl::unexpected(camera.error());
  devices.camera = std::move(*camera);
  return devices;
}

Result<std::unique_ptr<Camera>> open_camera(const Rig& rig, Clock& clock) {
  auto camera = std::visit([&](const auto& backend) { return open_camera(rig, backend, clock); },
                           rig.camera.backend);
  if (!camera) return tl::unexpected(with_context("open camera", camera.error()));
  return camera;
}

Result<void> make_safe(const Rig& rig, Clock& clock) {
  constexpr std::chrono::seconds answer_time{2};
  const bool on_gantry = std::holds_alternative<GantryLamp>(rig.lamp.backend);
  Result<std::unique_ptr<Lamp>> lamp = std::unique_ptr<Lamp>();
  if (!on_gantry)
    lamp = std::visit([&](const auto& backend) { return open_lamp(rig, backend, clock); },
                      rig.lamp.backend);
  // Dark at once: the gantry's wire may take its time to fail.
  Result<void> dark = lamp ? Result<void>() : Result<void>(tl::unexpected(lamp.error()));
  if (lamp && *lamp) dark = (*lamp)->set(0, {clock.now() + answer_time, {}});
  auto gantry = std::visit([&](const auto& backend) { return open_gantry(rig, backend, clock); },
                           rig.gantry.backend);
  if (on_gantry) {
    dark = gantry ? Result<void>() : Result<void>(tl::unexpected(gantry.error()));
    if (gantry && gantry->lamp) dark = gantry->lamp->set(0, {clock.now() + answer_time, {}});
  }
  Result<void> still = gantry ? Result<void>() : Result<void>(tl::unexpected(gantry.error()));
  if (gantry) gantry->gantry.reset();  // which stops the motion
  if (!dark)
    return tl::unexpected(
        with_context("make the rig safe: LAMP MAY BE ON, look at it", dark.error()));
  if (!still)
    return tl::unexpected(with_context(
        "make the rig safe: the lamp is dark, the gantry may be moving", still.error()));
  return {};
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
