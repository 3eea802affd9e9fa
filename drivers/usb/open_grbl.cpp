// Opening a GRBL gantry: what the controller is set to must not be more than the rig file allows.
#include <fmt/format.h>

#include <map>

#include "drivers/backends.h"
#include "drivers/usb/grbl_gantry.h"

namespace lightrig {
namespace {

constexpr std::chrono::seconds opening_time{8};  // some controllers boot for seconds after DTR

Result<void> check_settings(const Rig& rig, const GrblGantry& backend,
                            const std::map<int, double>& settings) {
  const auto setting = [&](int number) {
    const auto found = settings.find(number);
    return found == settings.end() ? 0.0 : found->second;
  };
  if (setting(22) < 1)
    return fail(ErrorCode::refused,
                "homing is off in the controller ($22=0): without it positions mean nothing; "
                "set $22=1");
  if (setting(13) != 0)
    return fail(ErrorCode::refused, "the controller reports inches ($13=1): set $13=0");
  for (std::size_t i = 0; i < backend.letters.size(); ++i) {
    const int axis = static_cast<int>(grbl::machine_axis(backend.letters[i]));
    const double allowed = rig.gantry.model.axes[i].max_acceleration * backend.units_per_si[i];
    if (setting(120 + axis) > allowed * 1.001)
      return fail(
          ErrorCode::refused,
          fmt::format("the controller accelerates axis {} with ${} = {} mm/s², the rig file "
                      "allows {:.3f}: lower ${}",
                      backend.letters[i], 120 + axis, setting(120 + axis), allowed, 120 + axis));
  }
  const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend);
  if (lamp && lamp->output == "spindle" && setting(32) != 0)
    return fail(ErrorCode::refused,
                "laser mode is on ($32=1): the lamp would go dark whenever the gantry rests; "
                "set $32=0");
  if (lamp && lamp->output == "spindle" && !(setting(30) > 0))
    return fail(ErrorCode::refused,
                "the controller's full spindle speed is 0 ($30=0), so the lamp's power means "
                "nothing: set $30=1000");
  if (lamp && lamp->output != "spindle" && lamp->output != "flood" && lamp->output != "mist")
    return fail(ErrorCode::invalid_input,
                fmt::format("a GRBL controller has no output \"{}\": spindle, flood or mist",
                            lamp->output));
  return {};
}

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig& rig, const GrblGantry& backend, Clock& clock) {
  const Until until{clock.now() + opening_time, {}};
  auto link = GrblLink::open(backend, clock, until);
  if (!link) return tl::unexpected(link.error());
  auto settings = link->settings(until);
  if (!settings) return tl::unexpected(with_context("read the settings", settings.error()));
  if (auto sound = check_settings(rig, backend, *settings); !sound)
    return tl::unexpected(sound.error());
  auto controller =
      std::make_shared<GrblController>(GrblController{std::move(*link), std::move(*settings)});
  GantryAndLamp opened;
  opened.gantry = std::make_unique<GrblGantryDevice>(rig, backend, clock, controller);
  if (const auto* lamp = std::get_if<GantryLamp>(&rig.lamp.backend))
    opened.lamp = std::make_unique<GrblLampDevice>(*lamp, rig.lamp.max_power, clock, controller);
  return opened;
}

Backend usb_backend() { return {"usb", true, ""}; }

}  // namespace lightrig
