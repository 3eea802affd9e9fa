#include "config/check_backends.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "config/descriptions.h"
#include "config/suggest.h"

namespace lightrig {
namespace {

const std::vector<std::string> grbl_outputs = {"spindle", "flood", "mist"};
const std::vector<std::string> grbl_inputs = {"door", "hold", "reset", "probe"};

std::string list_of(const std::vector<std::string>& names) {
  return names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "));
}

template <class T>
std::vector<std::string> names_of(const std::map<std::string, T>& map) {
  std::vector<std::string> names;
  for (const auto& [name, value] : map) names.push_back(name);
  return names;
}

// Every axis of the gantry is moved by exactly one of `links` (drives, or G-code letters).
void check_links(const Section& gantry, const std::vector<const Section*>& links,
                 const Section& backend, const char* link, Findings& findings) {
  std::map<std::string, const Section*> seen;
  for (const Section* one : links) {
    if (!one->has("axis")) continue;
    const auto [at, first] = seen.emplace(one->text("axis"), one);
    if (!first)
      findings.error(one->at("axis"),
                     fmt::format("axis \"{}\" has two tables [[{}.{}]]; the first "
                                 "is in line {}",
                                 one->text("axis"), backend.path, link, at->second->place.line));
  }
  for (const Section* axis : gantry.all("axis"))
    if (axis->has("name") && !links.empty() && !seen.contains(axis->text("name")))
      findings.error(backend.place, fmt::format("nothing moves axis \"{}\": add a [[{}.{}]] table",
                                                axis->text("name"), backend.path, link));
}

// Drives on one serial line must agree about it, and no two may answer to one number.
void check_lines(const std::vector<const Section*>& drives, Findings& findings) {
  const std::vector<std::string> settings = {"baud", "parity", "data_bits", "stop_bits", "rs485"};
  for (std::size_t i = 0; i < drives.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Section &a = *drives[j], &b = *drives[i];
      const bool serial =
          a.has("device") && b.has("device") && a.text("device") == b.text("device");
      const bool tcp = a.has("host") && b.has("host") && a.text("host") == b.text("host") &&
                       a.has("port") && b.has("port") && a.integer("port") == b.integer("port");
      if (!serial && !tcp) continue;
      if (a.has("unit") && b.has("unit") && a.integer("unit") == b.integer("unit"))
        findings.error(b.at("unit"), fmt::format("unit {} on this wire is already in use, in line "
                                                 "{}",
                                                 b.integer("unit"), a.at("unit").line));
      if (!serial) continue;
      for (std::size_t k = 0; k < b.cells.size(); ++k) {
        const Cell &ca = a.cells[k], &cb = b.cells[k];
        const bool setting = std::ranges::find(settings, cb.spec->name) != settings.end();
        if (setting && ca.value != cb.value)
          findings.error(cb.given ? cb.place : b.place,
                         fmt::format("{} differs from what line {} says of the same serial line {}",
                                     cb.spec->name, ca.place.line, to_toml(b.text("device"))));
      }
    }
  }
}

bool uses(const ControllerProfile& profile, RawUnit unit) {
  return std::ranges::any_of(profile.move.writes,
                             [&](const ProfileWrite& w) { return w.item.unit == unit; });
}

void check_drive_limits(const Section& gantry, const Section& drive,
                        const ControllerProfile& profile, Findings& findings) {
  if (!drive.has("axis")) return;
  const auto linear = linear_axes();
  const bool slides = std::ranges::find(linear, drive.text("axis")) != linear.end();
  const std::string counts_key = slides ? "counts_per_mm" : "counts_per_deg";
  const std::string zero_key = slides ? "zero_mm" : "zero_deg";
  const std::string speed_key = slides ? "max_speed_mm_per_s" : "max_speed_deg_per_s";
  if (!drive.has(counts_key)) return;
  for (const Section* axis : gantry.all("axis")) {
    if (!axis->has("name") || axis->text("name") != drive.text("axis")) continue;
    const double per_si = drive.number(counts_key);
    if (axis->has(speed_key) && profile.limits.max_speed) {
      const double speed = std::abs(per_si) * axis->number(speed_key);
      if (speed > *profile.limits.max_speed)
        findings.error(axis->at(speed_key),
                       fmt::format("this is {:g} counts/s; {} takes at most {:g}", speed,
                                   profile.name, *profile.limits.max_speed));
    }
    const bool bounded = profile.limits.min_position || profile.limits.max_position;
    if (!bounded || !drive.has(zero_key)) continue;
    for (const char* key : {slides ? "min_mm" : "min_deg", slides ? "max_mm" : "max_deg"}) {
      if (!axis->has(key)) continue;
      const double counts = (axis->number(key) - drive.number(zero_key)) * per_si;
      if ((profile.limits.min_position && counts < double(*profile.limits.min_position)) ||
          (profile.limits.max_position && counts > double(*profile.limits.max_position)))
        findings.error(axis->at(key),
                       fmt::format("this is {:.0f} counts, outside of what {} can hold", counts,
                                   profile.name));
    }
  }
}

// A scale of nothing per degree or millimetre would leave the axis where it is.
void check_scale(const Section& link, const std::string& per, Findings& findings) {
  for (const std::string& key : {per + "_per_deg", per + "_per_mm"})
    if (link.given_key(key) && link.has(key) && link.number(key) == 0)
      findings.error(link.at(key), key + " is 0; the axis would never move");
}

void check_modbus(const Section& gantry, const ControllerProfile* profile, Findings& findings) {
  const Section& modbus = gantry.table("modbus");
  const std::vector<const Section*> drives = modbus.all("drive");
  check_links(gantry, drives, modbus, "drive", findings);
  check_lines(drives, findings);
  const bool serial =
      std::ranges::any_of(drives, [](const Section* drive) { return drive->given_key("device"); });
  if (profile != nullptr && serial && profile->watchdog && modbus.has("timeout_ms") &&
      6 * modbus.integer("timeout_ms") >= profile->watchdog->timeout.count())
    findings.error(
        modbus.at("timeout_ms"),
        fmt::format("a lost answer would set off the drives' watchdog of {} ms: on a serial line "
                    "the wire is silent for three timeouts then, and the watchdog is fed at a "
                    "third of its time; keep timeout_ms below a sixth of it",
                    profile->watchdog->timeout.count()));
  for (const Section* drive : drives) {
    check_scale(*drive, "counts", findings);
    if (profile == nullptr) continue;
    if (drive->given_key("host") && !profile->tcp)
      findings.error(drive->at("host"), fmt::format("{} does not speak Modbus TCP; name its serial "
                                                    "port as device",
                                                    profile->name));
    if (drive->given_key("device") && !profile->rtu)
      findings.error(drive->at("device"),
                     fmt::format("{} does not speak Modbus RTU; name its host", profile->name));
    const bool rpm = uses(*profile, RawUnit::rpm) || uses(*profile, RawUnit::ms_per_1000_rpm);
    if (rpm && !drive->given_key("counts_per_rev"))
      findings.error(drive->place,
                     fmt::format("[{}] lacks counts_per_rev: {} takes speeds in rpm of the motor",
                                 drive->path, profile->name));
    check_drive_limits(gantry, *drive, *profile, findings);
  }
}

void check_grbl(const Section& gantry, Findings& findings) {
  const Section& grbl = gantry.table("grbl");
  check_links(gantry, grbl.all("axis"), grbl, "axis", findings);
  std::map<std::string, const Section*> letters;
  for (const Section* axis : grbl.all("axis")) {
    check_scale(*axis, "units", findings);
    if (!axis->has("letter")) continue;
    const auto [at, first] = letters.emplace(axis->text("letter"), axis);
    if (!first)
      findings.error(axis->at("letter"),
                     fmt::format("letter {} is already in use, in line {}", axis->text("letter"),
                                 at->second->at("letter").line));
  }
}

// The names that inputs or outputs of the gantry's controller may have; empty where unknown.
struct Names {
  bool known = false;
  std::vector<std::string> names;
  std::string whose;
};

Names controller_names(const Section& gantry, const ControllerProfile* profile, bool outputs) {
  if (!gantry.has("backend")) return {};
  if (gantry.text("backend") == "grbl")
    return {true, outputs ? grbl_outputs : grbl_inputs, "a GRBL controller"};
  if (gantry.text("backend") == "modbus" && profile != nullptr)
    return {true, outputs ? names_of(profile->outputs) : names_of(profile->inputs),
            "profile " + profile->name};
  return {};
}

void check_name(const Section& table, const std::string& key, const char* what, const Names& names,
                Findings& findings) {
  if (!names.known || !table.has(key)) return;
  const std::string& name = table.text(key);
  if (std::ranges::find(names.names, name) != names.names.end()) return;
  findings.error(
      table.at(key),
      fmt::format("{} has no {} \"{}\"; it has: {}", names.whose, what, name, list_of(names.names)),
      did_you_mean(name, names.names));
}

/// What switches this lamp on at full power and no other way; "" where it dims, or where that is
/// not known.
std::string what_only_switches(const Section& lamp, const Section& gantry,
                               const ControllerProfile* profile) {
  if (const Section* unit = lamp.find("modbus"))
    return unit->has("coil") ? std::string("a coil") : std::string();
  const auto of_grbl = [](const std::string& name) -> std::string {
    return name == "flood" || name == "mist" ? fmt::format("GRBL's output \"{}\"", name) : "";
  };
  if (const Section* own = lamp.find("grbl"))
    return own->has("output") ? of_grbl(own->text("output")) : std::string();
  const Section* wired = lamp.find("gantry");
  if (wired == nullptr || !wired->has("output") || !gantry.has("backend")) return {};
  const std::string& name = wired->text("output");
  if (gantry.text("backend") == "grbl") return of_grbl(name);
  if (gantry.text("backend") != "modbus" || profile == nullptr) return {};
  const auto output = profile->outputs.find(name);
  if (output == profile->outputs.end() || output->second.dimmable) return {};
  return fmt::format("output \"{}\" of profile {}, which does not say dimmable = true,", name,
                     profile->name);
}

// A lamp that cannot be dimmed burns at full power whatever is asked of it.
void check_dimming(const Section& lamp, const Section& gantry, const ControllerProfile* profile,
                   Findings& findings) {
  const std::string what = what_only_switches(lamp, gantry, profile);
  if (what.empty()) return;
  for (const char* key : {"max_power", "power"})
    if (lamp.has(key) && lamp.number(key) != 1)
      findings.error(
          lamp.at(key),
          fmt::format("lamp.{} is {}, but {} only switches the lamp on and off, on being "
                      "full power: it must be 1; what that is in light, "
                      "the strength says",
                      key, lamp.number(key), what));
}

// A lamp on a GRBL controller of its own: an output that there is, and not the gantry's controller.
void check_grbl_lamp(const Section& lamp, const Section* gantry, Findings& findings) {
  check_name(lamp, "output", "output", {true, grbl_outputs, "a GRBL controller"}, findings);
  if (gantry == nullptr) return;
  const auto same = [&](const char* key) {
    return lamp.given_key(key) && gantry->given_key(key) && lamp.text(key) == gantry->text(key);
  };
  if (same("device") || same("usb_serial"))
    findings.error(lamp.place,
                   fmt::format("[{}] names the gantry's own controller; its lamp is backend = "
                               "\"gantry\" with [lamp.gantry]",
                               lamp.path));
}

}  // namespace

void check_backends(const Section& root, const ControllerProfile* profile, Findings& findings) {
  const Section* gantry = root.find("gantry");
  if (gantry == nullptr) return;
  if (gantry->find("modbus") != nullptr) check_modbus(*gantry, profile, findings);
  if (gantry->find("grbl") != nullptr) check_grbl(*gantry, findings);
  const bool simulated = gantry->has("backend") && gantry->text("backend") == "simulated";
  for (const Section* interlock : root.all("interlocks"))
    check_name(*interlock, "input", "input", controller_names(*gantry, profile, false), findings);
  const Section* lamp = root.find("lamp");
  if (lamp == nullptr) return;
  check_dimming(*lamp, *gantry, profile, findings);
  if (lamp->find("grbl") != nullptr)
    check_grbl_lamp(lamp->table("grbl"), gantry->find("grbl"), findings);
  const Section* wired = lamp->find("gantry");
  if (wired == nullptr) return;
  if (simulated)
    findings.error(lamp->at("backend"),
                   fmt::format("the lamp hangs on the gantry's controller, but gantry.backend is "
                               "\"simulated\" (line {}), which has none",
                               gantry->at("backend").line));
  check_name(*wired, "output", "output", controller_names(*gantry, profile, true), findings);
}

}  // namespace lightrig
