#include "config/check_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "config/check_backends.h"
#include "config/descriptions.h"
#include "config/suggest.h"

namespace lightrig {
namespace {

void check_sensor(const Section& s, Findings& findings) {
  if (s.has("min_exposure_s") && s.has("max_exposure_s") &&
      s.number("min_exposure_s") >= s.number("max_exposure_s"))
    findings.error(s.at("max_exposure_s"),
                   fmt::format("camera.sensor.max_exposure_s is {} s; it must be longer than "
                               "min_exposure_s, {} s",
                               s.number("max_exposure_s"), s.number("min_exposure_s")));
  if (!s.has("bits") || !s.has("black_level_dn")) return;
  const double white = std::exp2(s.integer("bits")) - 1, black = s.number("black_level_dn");
  if (black >= white) {
    findings.error(s.at("black_level_dn"),
                   fmt::format("camera.sensor.black_level_dn is {} DN; it must be below the white "
                               "level, {} DN with {} bits",
                               black, white, s.integer("bits")));
    return;
  }
  if (!s.has("full_well_e") || !s.has("gain_e_per_dn")) return;
  const double range = (white - black) * s.number("gain_e_per_dn");
  if (s.number("full_well_e") < 0.5 * range)
    findings.warning(s.at("full_well_e"),
                     fmt::format("the full well, {} e⁻, fills less than half of the counts: white "
                                 "level {} DN is {:.0f} e⁻ at this gain",
                                 s.number("full_well_e"), white, range));
  if (s.has("read_noise_e") && s.number("read_noise_e") >= s.number("full_well_e"))
    findings.error(s.at("read_noise_e"),
                   fmt::format("camera.sensor.read_noise_e is {} e⁻; it must be below full_well_e, "
                               "{} e⁻",
                               s.number("read_noise_e"), s.number("full_well_e")));
}

void check_pose(const Section& s, Findings& findings) {
  if (!s.given_key("eye_m") && !s.given_key("calibration"))
    findings.error(s.place,
                   "[camera] lacks eye_m ([x, y, z], m), where the camera's centre is, or "
                   "calibration, a file that `lightrig calibrate camera --board-origin-m` wrote");
  if (!s.has("eye_m") || !s.has("target_m") || !s.has("up")) return;
  const Eigen::Vector3d sight = s.vector3("target_m") - s.vector3("eye_m");
  const Eigen::Vector3d up = s.vector3("up");
  if (sight.norm() < 1e-9) {
    findings.error(s.at("eye_m"),
                   "camera.eye_m and target_m are the same point; the camera has no direction");
    return;
  }
  if (up.norm() < 1e-9) {
    findings.error(s.at("up"), "camera.up is zero; it must be a direction");
    return;
  }
  if (sight.normalized().cross(up.normalized()).norm() < 1e-6)
    findings.error(s.at("up"),
                   "camera.up points along the line of sight; the image has no upper side");
}

void check_lens(const Section& s, Findings& findings) {
  if (!s.has("projection") || s.text("projection") != "perspective") return;
  const bool calibrated = s.given_key("calibration");
  if (!calibrated && !s.given_key("fx_px"))
    findings.error(s.place,
                   "[camera] lacks fx_px (number, > 0 px), focal length over pixel pitch, or "
                   "calibration, a file that `lightrig calibrate camera` wrote; one of them is "
                   "needed because projection is \"perspective\"");
  for (const char* key : {"fx_px", "fy_px", "cx_px", "cy_px", "distortion"})
    if (calibrated && s.given_key(key))
      findings.error(s.at(key), fmt::format("camera.{} conflicts with calibration (line {}), which "
                                            "states it too",
                                            key, s.at("calibration").line));
}

void check_camera(const Section& s, Findings& findings) {
  check_lens(s, findings);
  if (const Section* sensor = s.find("sensor")) check_sensor(*sensor, findings);
  check_pose(s, findings);
  for (const auto& [key, size] : {std::pair("cx_px", "width_px"), std::pair("cy_px", "height_px")})
    if (s.has(key) && s.has(size) && (s.number(key) < 0 || s.number(key) > s.integer(size) - 1))
      findings.warning(s.at(key), fmt::format("camera.{} is {} px, outside the image of {} px", key,
                                              s.number(key), s.integer(size)));
  if (s.has("width_px") && s.has("height_px")) {
    const double pixels = double(s.integer("width_px")) * s.integer("height_px");
    if (pixels > double(1 << 27))
      findings.error(s.at("height_px"), fmt::format("a frame of {:.0f} pixels; at most {} can be "
                                                    "held",
                                                    pixels, 1 << 27));
  }
}

constexpr double in_degrees = 1 / units::degree;

// How an axis writes its numbers.
struct AxisUnit {
  std::string min = "min_deg", max = "max_deg", home = "home_deg", tolerance = "tolerance_deg";
  double scale = in_degrees;
  const char* unit = "°";
};
AxisUnit unit_of(const Section& axis) {
  const auto linear = linear_axes();
  const bool slides =
      axis.has("name") && std::ranges::find(linear, axis.text("name")) != linear.end();
  if (!slides) return {};
  return {"min_mm", "max_mm", "home_mm", "tolerance_mm", 1e3, " mm"};
}

void check_axis(const Section& axis, Findings& findings) {
  const AxisUnit u = unit_of(axis);
  if (!axis.has(u.min) || !axis.has(u.max)) return;
  const double least = axis.number(u.min), most = axis.number(u.max);
  const std::string name = axis.has("name") ? axis.text("name") : axis.path;
  if (least >= most) {
    findings.error(axis.at(u.max),
                   fmt::format("{}: {} is {:g}{}; it must be greater than {}, {:g}{}", name, u.max,
                               most * u.scale, u.unit, u.min, least * u.scale, u.unit));
    return;
  }
  if (axis.has(u.home) && (axis.number(u.home) < least || axis.number(u.home) > most))
    findings.error(axis.at(u.home),
                   fmt::format("{}: {} is {:g}{}, outside the travel {:g} … {:g}{}", name, u.home,
                               axis.number(u.home) * u.scale, u.unit, least * u.scale,
                               most * u.scale, u.unit));
}

void check_tolerance(const Section& gantry, const Section& axis, Findings& findings) {
  const AxisUnit u = unit_of(axis);
  if (!gantry.has(u.tolerance) || !axis.has(u.min) || !axis.has(u.max)) return;
  const double travel = axis.number(u.max) - axis.number(u.min);
  if (travel > 0 && gantry.number(u.tolerance) >= travel)
    findings.error(
        gantry.at(u.tolerance),
        fmt::format("gantry.{} is {:g}{}, as much as the whole travel of "
                    "{}: every move would have arrived",
                    u.tolerance, gantry.number(u.tolerance) * u.scale, u.unit, axis.text("name")));
}

// "a dome needs …", "a turntable needs …"
std::string with_article_of(const std::string& kinematics) {
  if (kinematics == "dome" || kinematics == "turntable") return fmt::format("a {}", kinematics);
  return kinematics == "lamps" ? std::string("a set of fixed lamps")
                               : fmt::format("a {} gantry", kinematics);
}

void check_kinematics(const Section& gantry, const std::map<std::string, const Section*>& seen,
                      Findings& findings) {
  const std::string& kind = gantry.text("kinematics");
  const std::vector<std::string> axes = axes_of_kinematics(kind);
  for (const auto& [name, axis] : seen)
    if (std::ranges::find(axes, name) == axes.end())
      findings.error(
          axis->at("name"),
          fmt::format("{} has no axis \"{}\"{}", with_article_of(kind), name,
                      axes.empty() ? "; nothing of it moves"
                                   : fmt::format("; it has: {}", fmt::join(axes, ", "))));
  const bool table = kind == "turntable";
  for (const std::string& name : axes) {
    if (seen.contains(name)) continue;
    if (!table || name == "turn")
      findings.error(gantry.place,
                     fmt::format("{} needs an axis \"{}\": add a [[gantry.axis]] table",
                                 with_article_of(kind), name));
    else if (!gantry.has("lamp_elevation_deg"))
      findings.error(gantry.place,
                     "a turntable whose lamp has no axis \"elevation\" needs lamp_elevation_deg");
  }
  if (table && seen.contains("elevation") && gantry.given_key("lamp_elevation_deg"))
    findings.error(gantry.at("lamp_elevation_deg"),
                   "the lamp's elevation is given, but is an axis too; leave one of them out");
}

void check_axes(const Section& gantry, Findings& findings) {
  std::map<std::string, const Section*> seen;
  for (const Section* axis : gantry.all("axis")) {
    check_axis(*axis, findings);
    if (!axis->has("name")) continue;
    const auto [at, first] = seen.emplace(axis->text("name"), axis);
    if (!first)
      findings.error(axis->at("name"), fmt::format("axis \"{}\" is described twice; the first is "
                                                   "in line {}",
                                                   axis->text("name"), at->second->place.line));
    check_tolerance(gantry, *axis, findings);
  }
  if (gantry.has("kinematics") && !seen.empty()) check_kinematics(gantry, seen, findings);
}

void check_solid(const Section& body, Findings& findings) {
  if (body.has("boom_direction") && body.vector3("boom_direction").norm() < 1e-9)
    findings.error(body.at("boom_direction"),
                   "gantry.body.boom_direction is zero; it must be a "
                   "direction");
  if (body.has("camera_length_m") && body.number("camera_length_m") > 0 &&
      body.has("camera_radius_m") && !(body.number("camera_radius_m") > 0))
    findings.error(body.at("camera_length_m"),
                   "gantry.body.camera_length_m goes with a camera_radius_m above 0");
}

/// Said of hardware alone: what moves in memory touches nothing.
void check_body(const Section& gantry, Findings& findings) {
  if (gantry.find("body") != nullptr || !gantry.has("kinematics") || !gantry.has("backend") ||
      gantry.text("backend") == "simulated")
    return;
  const std::string& kind = gantry.text("kinematics");
  const bool lamp_moves =
      kind == "turntable"
          ? std::ranges::any_of(gantry.all("axis"),
                                [](const Section* axis) {
                                  return axis->has("name") && axis->text("name") == "elevation";
                                })
          : kind != "lamps";
  if (lamp_moves) findings.warning(gantry.place, no_body_remark);
}

void check_emission(const Section& lamp, Findings& findings) {
  if (!lamp.has("emission_angles_deg") || !lamp.has("emission_relative")) return;
  const std::vector<double> angles = lamp.numbers("emission_angles_deg");
  const std::vector<double> values = lamp.numbers("emission_relative");
  if (angles.size() != values.size())
    findings.error(lamp.at("emission_relative"),
                   fmt::format("lamp.emission_relative has {} values for {} angles", values.size(),
                               angles.size()));
  if (angles.front() != 0)
    findings.error(lamp.at("emission_angles_deg", 0),
                   "lamp.emission_angles_deg must begin with 0, the lamp's axis");
  for (std::size_t i = 1; i < angles.size(); ++i)
    if (!(angles[i] > angles[i - 1]))
      findings.error(
          lamp.at("emission_angles_deg", i),
          fmt::format("lamp.emission_angles_deg[{}] is not greater than the one before", i + 1));
  if (!(values.front() > 0))
    findings.error(lamp.at("emission_relative", 0),
                   "lamp.emission_relative is 0 along the axis, which strength_w_per_sr speaks of");
}

// What kind of gantry goes with what kind of lamp and candidates.
void check_fit(const Section& root, const Section& gantry, Findings& findings) {
  if (!gantry.has("kinematics")) return;
  const std::string& kind = gantry.text("kinematics");
  const Section* lamp = root.find("lamp");
  const bool cartesian = kind.starts_with("cartesian");
  if (lamp != nullptr && cartesian && lamp->has("kind") && lamp->text("kind") == "distant")
    findings.error(lamp->at("kind"),
                   "a lamp on linear axes has no direction of its own; it is "
                   "\"near\"");
  if (gantry.has("backend") && (gantry.text("backend") == "lamps") != (kind == "lamps") &&
      gantry.text("backend") != "simulated")
    findings.error(gantry.at("backend"),
                   "backend \"lamps\" and kinematics \"lamps\" go together, or with backend "
                   "\"simulated\"");
  const Section* wires = lamp == nullptr ? nullptr : lamp->find("modbus");
  if (gantry.has("backend") && gantry.text("backend") == "lamps" && lamp != nullptr &&
      (wires == nullptr || !wires->has("coil")))
    findings.error(lamp->place, "fixed lamps need [lamp.modbus] with the coil of the first one");
  const Section* candidates = root.find("candidates");
  if (candidates == nullptr || !candidates->has("rule")) return;
  const std::string& rule = candidates->text("rule");
  if (kind == "turntable" && rule == "fibonacci")
    findings.error(candidates->given ? candidates->place : gantry.at("kinematics"),
                   "every turn of the object is another view, which has to be looked at: a "
                   "turntable's candidates need rule \"grid\" or \"list\"");
  if (cartesian && rule == "fibonacci" && !candidates->has("sphere_radius_m"))
    findings.error(candidates->given ? candidates->place : gantry.at("kinematics"),
                   "candidates on linear axes need rule \"grid\" or \"list\", or a "
                   "sphere_radius_m for \"fibonacci\"");
  if (rule != "grid" || !candidates->has("steps") || kind == "lamps") return;
  const std::size_t wanted = cartesian ? 3 : gantry.all("axis").size();
  if (candidates->integers("steps").size() != wanted)
    findings.error(candidates->at("steps"),
                   fmt::format("candidates.steps has {} numbers for {} axes",
                               candidates->integers("steps").size(), wanted));
}

void check_lamp(const Section& root, Findings& findings) {
  const Section& lamp = root.table("lamp");
  if (lamp.has("power") && lamp.has("max_power") && lamp.number("power") > lamp.number("max_power"))
    findings.error(lamp.at("power"), fmt::format("lamp.power is {}; it must not exceed max_power, "
                                                 "{}",
                                                 lamp.number("power"), lamp.number("max_power")));
  const Section* camera = root.find("camera");
  const Section* sensor = camera == nullptr ? nullptr : camera->find("sensor");
  if (sensor != nullptr && sensor->has("max_exposure_s") && lamp.has("max_on_time_s") &&
      sensor->number("max_exposure_s") >= lamp.number("max_on_time_s"))
    findings.error(lamp.at("max_on_time_s"),
                   fmt::format("lamp.max_on_time_s is {} s; it must be longer than the camera's "
                               "longest exposure, {} s, or the lamp goes dark in the middle of it",
                               lamp.number("max_on_time_s"), sensor->number("max_exposure_s")));
}

/// The bounds of every condition in the right order, and a sensor to read where one is needed.
void check_pause(const Section& root, const Section& pause, Findings& findings) {
  constexpr std::array<std::pair<const char*, const char*>, 4> conditions{
      {{"packet_loss", "_per_frame"},
       {"lamp_drift", "_percent"},
       {"lamp_temperature", "_c"},
       {"camera_temperature", "_c"}}};
  for (const auto& [name, unit] : conditions) {
    const Section* s = pause.find(name);
    const std::string upper = std::string("pause_above") + unit;
    const std::string lower = std::string("resume_below") + unit;
    if (s == nullptr || !s->has(upper) || !s->has(lower)) continue;
    if (s->number(lower) > s->number(upper))
      findings.error(s->at(lower),
                     fmt::format("{}.{} is {:g}; it must not exceed {}, {:g}", s->path, lower,
                                 s->number(lower), upper, s->number(upper)));
  }
  const Section* hot = pause.find("lamp_temperature");
  const Section* lamp = root.find("lamp");
  if (hot == nullptr || lamp == nullptr || !lamp->has("backend")) return;
  const Section* modbus = lamp->find("modbus");
  if (lamp->text("backend") == "simulated" || (modbus != nullptr && modbus->has("temperature")))
    return;
  findings.error(hot->place, fmt::format("[{}]: this lamp has no temperature that could be read; "
                                         "name its register as lamp.modbus.temperature, or remove "
                                         "this table",
                                         hot->path));
}

void check_keep_out(const Section& volume, Findings& findings) {
  if (!volume.has("min_m") || !volume.has("max_m")) return;
  if ((volume.vector3("min_m").array() >= volume.vector3("max_m").array()).any())
    findings.error(
        volume.at("max_m"),
        fmt::format("[{}]: every coordinate of max_m must be greater than min_m's", volume.path));
}

void check_candidates(const Section& s, Findings& findings) {
  if (!s.has("positions_m")) return;
  const std::vector<Eigen::Vector3d> list = s.vectors("positions_m");
  for (std::size_t i = 0; i < list.size(); ++i)
    if (list[i].norm() < 1e-12)
      findings.error(s.at("positions_m", i),
                     fmt::format("candidates.positions_m[{}] is the origin; a lamp cannot stand "
                                 "there, and it is no direction",
                                 i + 1));
}

}  // namespace

std::vector<std::string> axes_of_kinematics(const std::string& kinematics) {
  if (kinematics == "dome") return {"azimuth", "elevation"};
  if (kinematics == "cartesian") return {"x", "y", "z"};
  if (kinematics == "cartesian_aimed") return {"x", "y", "z", "pan", "tilt"};
  if (kinematics == "turntable") return {"turn", "elevation"};
  return {};  // fixed lamps
}

void check_rig(const Section& root, const ControllerProfile* profile, Findings& findings) {
  if (const Section* camera = root.find("camera")) check_camera(*camera, findings);
  if (const Section* gantry = root.find("gantry")) {
    check_axes(*gantry, findings);
    if (const Section* body = gantry->find("body")) check_solid(*body, findings);
    check_body(*gantry, findings);
    check_fit(root, *gantry, findings);
  }
  if (const Section* lamp = root.find("lamp")) {
    check_lamp(root, findings);
    check_emission(*lamp, findings);
  }
  check_backends(root, profile, findings);
  if (const Section* pause = root.find("pause")) check_pause(root, *pause, findings);
  for (const Section* volume : root.all("keep_out")) check_keep_out(*volume, findings);
  if (const Section* candidates = root.find("candidates")) check_candidates(*candidates, findings);
}

}  // namespace lightrig
