#include <fmt/format.h>

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

/// Whether only the gantry's driver can reach all of the lamp: an output of its controller, or a
/// bank of lamps of which the choice is the gantry.
bool lamp_is_the_gantrys(const Rig& rig) {
  return std::holds_alternative<GantryLamp>(rig.lamp.backend) ||
         std::holds_alternative<FixedLampsGantry>(rig.gantry.backend);
}

/// Whether the lamp comes with the gantry, since it is on its wire.
bool lamp_shares_gantrys_wire(const Rig& rig) {
  const auto* lamp = std::get_if<ModbusLamp>(&rig.lamp.backend);
  const auto* gantry = std::get_if<ModbusGantry>(&rig.gantry.backend);
  if (!lamp || !gantry) return lamp_is_the_gantrys(rig);
  return std::any_of(gantry->drives.begin(), gantry->drives.end(), [&](const ModbusDrive& drive) {
    return wire_of(drive.endpoint) == wire_of(lamp->endpoint);
  });
}

/// A rig of which a part cannot be had in this build is not opened half: what is absent is said
/// before a gantry is asked for anything.
Result<void> all_built(const Rig& rig) {
  const std::vector<std::string> named = backends_named_by(rig);
  for (const Backend& backend : backends()) {
    if (backend.built || std::find(named.begin(), named.end(), backend.name) == named.end())
      continue;
    return fail(ErrorCode::not_built, fmt::format("open the devices: the rig file names {}: {}",
                                                  backend.name, backend.remedy));
  }
  return {};
}

}  // namespace

Result<Devices> open_devices(const Rig& rig, Clock& clock) {
  if (auto all = all_built(rig); !all) return tl::unexpected(all.error());
  Devices devices;
  auto gantry = std::visit([&](const auto& backend) { return open_gantry(rig, backend, clock); },
                           rig.gantry.backend);
  if (!gantry) return tl::unexpected(with_context("open gantry", gantry.error()));
  devices.gantry = std::move(gantry->gantry);
  devices.lamp = std::move(gantry->lamp);
  if (!devices.lamp) {
    auto lamp = open_lamp(rig, clock);
    if (!lamp) return tl::unexpected(lamp.error());
    devices.lamp = std::move(*lamp);
  }
  auto camera = open_camera(rig, clock);
  if (!camera) return tl::unexpected(camera.error());
  devices.camera = std::move(*camera);
  return devices;
}

std::vector<TriedDevice> try_devices(const Rig& rig, Clock& clock) {
  TriedDevice gantry{"gantry", {}, {}}, lamp{"lamp", {}, {}}, camera{"camera", {}, {}};
  auto moving = std::visit([&](const auto& backend) { return open_gantry(rig, backend, clock); },
                           rig.gantry.backend);
  if (!moving) gantry.problem = "open gantry: " + moving.error().message;
  // A gantry that did not open has given the wire back; a unit of the lamp's own may answer on it.
  if (!moving && lamp_is_the_gantrys(rig)) {
    lamp.problem = "open lamp: it is reached through the gantry alone, which does not open";
  } else if (!moving || !moving->lamp) {
    if (const auto own = open_lamp(rig, clock); !own) lamp.problem = own.error().message;
  }
  if (const auto seeing = open_camera(rig, clock))
    camera.answer = (*seeing)->identity();
  else
    camera.problem = seeing.error().message;
  return {gantry, lamp, camera};
}

Result<std::unique_ptr<Camera>> open_camera(const Rig& rig, Clock& clock) {
  auto camera = std::visit([&](const auto& backend) { return open_camera(rig, backend, clock); },
                           rig.camera.backend);
  if (!camera) return tl::unexpected(with_context("open camera", camera.error()));
  return camera;
}

std::string wire_of(const std::variant<TcpEndpoint, SerialEndpoint>& endpoint) {
  if (const auto* tcp = std::get_if<TcpEndpoint>(&endpoint))
    return fmt::format("{}:{}", tcp->host, tcp->port);
  return std::get<SerialEndpoint>(endpoint).device;
}

Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, Clock& clock) {
  auto lamp = std::visit([&](const auto& backend) { return open_lamp(rig, backend, clock); },
                         rig.lamp.backend);
  if (!lamp) return tl::unexpected(with_context("open lamp", lamp.error()));
  return lamp;
}

bool lamp_has_own_wire(const Rig& rig) { return !lamp_shares_gantrys_wire(rig); }

Result<void> make_safe(const Rig& rig, Clock& clock) {
  const auto open_own_lamp = [&] {
    return std::visit([&](const auto& backend) { return open_lamp(rig, backend, clock); },
                      rig.lamp.backend);
  };
  const auto darken = [&](const Result<std::unique_ptr<Lamp>>& lamp) -> Result<void> {
    if (!lamp) return tl::unexpected(lamp.error());
    return (*lamp)->set(0, {clock.now() + std::chrono::seconds(2), {}});
  };
  const bool shared = lamp_shares_gantrys_wire(rig);
  Result<void> dark;
  // On a wire of its own it goes dark at once: the gantry's wire may take its time to fail.
  if (!shared) dark = darken(open_own_lamp());
  auto gantry = std::visit([&](const auto& backend) { return open_gantry(rig, backend, clock); },
                           rig.gantry.backend);
  const Result<void> still = gantry ? Result<void>() : Result<void>(tl::unexpected(gantry.error()));
  if (shared && gantry) dark = darken(std::move(gantry->lamp));
  // A gantry that cannot be reached has given the wire back; a unit of the lamp's own may answer.
  if (shared && !gantry) dark = lamp_is_the_gantrys(rig) ? still : darken(open_own_lamp());
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
  if (std::holds_alternative<GrblGantry>(rig.gantry.backend) ||
      std::holds_alternative<GrblLamp>(rig.lamp.backend))
    names.emplace_back("usb");
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
