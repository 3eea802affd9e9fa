// Opening a GRBL gantry, or a lamp on a GRBL controller: what the controller is set to must not be
// more than the rig file allows.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "drivers/backends.h"
#include "drivers/usb/grbl_gantry.h"

namespace lightrig {
namespace {

constexpr std::chrono::seconds opening_time{12};  // some controllers boot for seconds after DTR

/// What the rig relies on must be there: a setting that is missing is not 0.
Result<void> require(const std::map<int, double>& settings, const std::vector<int>& numbers) {
  for (const int number : numbers)
    if (!settings.contains(number))
      return fail(ErrorCode::refused,
                  fmt::format("the controller's settings (\"$$\") have no ${}: is this GRBL 1.1 or "
                              "grblHAL, with that axis and output?",
                              number));
  return {};
}

// grblHAL adds bits for what may home by itself.
bool homing_is_on(const std::map<int, double>& settings) {
  return static_cast<long>(settings.at(22)) % 2 != 0;
}

/// That a lamp on this output can be switched, and by how much.
Result<void> check_output(const std::string& output, const std::map<int, double>& settings) {
  if (output == "spindle")
    if (auto there = require(settings, {30, 32}); !there) return there;
  if (output == "spindle" && settings.at(32) != 0)
    return fail(ErrorCode::refused,
                "laser mode is on ($32=1): the lamp would go dark whenever the controller rests; "
                "set $32=0");
  if (output == "spindle" && !(settings.at(30) > 0))
    return fail(ErrorCode::refused,
                "the controller's full spindle speed is 0 ($30=0), so the lamp's power means "
                "nothing: set $30=1000");
  if (output != "spindle" && output != "flood" && output != "mist")
    return fail(
        ErrorCode::invalid_input,
        fmt::format("a GRBL controller has no output \"{}\": spindle, flood or mist", output));
  return {};
}

Result<void> check_settings(const Rig& rig, const GrblGantry& backend,
                            const std::map<int, double>& settings) {
  std::vector<int> relied_on{13, 22};
  for (const char letter : backend.letters)
    relied_on.push_back(120 + static_cast<int>(grbl::machine_axis(letter)));
  if (auto there = require(settings, relied_on); !there) return there;
  const auto setting = [&](int number) { return settings.at(number); };
  if (!homing_is_on(settings))
    return fail(ErrorCode::refused,
                "homing is off in the controller ($22=0): without it positions mean nothing; "
                "set $22=1");
  if (setting(13) != 0)
    return fail(ErrorCode::refused, "the controller reports inches ($13=1): set $13=0");
  for (std::size_t i = 0; i < backend.letters.size(); ++i) {
    const int axis = static_cast<int>(grbl::machine_axis(backend.letters[i]));
    // A negative number of units turns the sense, not the speeds.
    const double allowed =
        rig.gantry.model.axes[i].max_acceleration * std::abs(backend.units_per_si[i]);
    if (setting(120 + axis) > allowed * 1.001)
      return fail(
          ErrorCode::refused,
          fmt::format("the controller accelerates axis {} with ${} = {} mm/s², the rig file "
                      "allows {:.3f}: lower ${}",
                      backend.letters[i], 120 + axis, setting(120 + axis), allowed, 120 + axis));
  }
  const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend);
  return lamp ? check_output(lamp->output, settings) : Result<void>();
}

Result<GrblController> open_controller(const GrblEndpoint& endpoint, std::size_t axes,
                                       Clock& clock) {
  const Until until{clock.now() + opening_time, {}};
  auto link = GrblLink::open(endpoint, axes, clock, until);
  if (!link) return tl::unexpected(link.error());
  auto settings = link->settings(until);
  if (!settings) return tl::unexpected(with_context("read the settings", settings.error()));
  return GrblController{std::move(*link), std::move(*settings)};
}

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig& rig, const GrblGantry& backend, Clock& clock) {
  std::size_t axes = 0;
  for (const char letter : backend.letters) axes = std::max(axes, grbl::machine_axis(letter) + 1);
  auto controls = open_controller(backend.endpoint, axes, clock);
  if (!controls) return tl::unexpected(controls.error());
  if (auto sound = check_settings(rig, backend, controls->settings); !sound)
    return tl::unexpected(sound.error());
  auto controller = std::make_shared<GrblController>(std::move(*controls));
  GantryAndLamp opened;
  opened.gantry = std::make_unique<GrblGantryDevice>(rig, backend, clock, controller);
  if (const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend))
    opened.lamp =
        std::make_unique<GrblLampDevice>(lamp->output, rig.lamp.max_power, clock, controller);
  return opened;
}

Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, const GrblLamp& backend, Clock& clock) {
  auto controls = open_controller(backend.endpoint, 0, clock);
  if (!controls) return tl::unexpected(controls.error());
  // Locked until it is homed, it would switch nothing; and it has no axes to home.
  if (auto there = require(controls->settings, {22}); !there) return tl::unexpected(there.error());
  if (homing_is_on(controls->settings))
    return fail(ErrorCode::refused,
                "homing is on in the lamp's controller ($22=1), which then obeys nothing until it "
                "is homed: set $22=0, and power it anew");
  if (auto sound = check_output(backend.output, controls->settings); !sound)
    return tl::unexpected(sound.error());
  return std::make_unique<GrblLampDevice>(backend.output, rig.lamp.max_power, clock,
                                          std::make_shared<GrblController>(std::move(*controls)));
}

Backend usb_backend() { return {"usb", true, ""}; }

}  // namespace lightrig
