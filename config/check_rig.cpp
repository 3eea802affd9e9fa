#include "config/check_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "config/check_backends.h"
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

void check_camera(const Section& s, Findings& findings) {
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

void check_axis(const Section& axis, Findings& findings) {
  if (!axis.has("min_deg") || !axis.has("max_deg")) return;
  const double least = axis.number("min_deg"), most = axis.number("max_deg");
  const std::string name = axis.has("name") ? axis.text("name") : axis.path;
  if (least >= most) {
    findings.error(axis.at("max_deg"),
                   fmt::format("{}: max_deg is {:g}°; it must be greater than min_deg, {:g}°", name,
                               most * in_degrees, least * in_degrees));
    return;
  }
  if (axis.has("home_deg") && (axis.number("home_deg") < least || axis.number("home_deg") > most))
    findings.error(
        axis.at("home_deg"),
        fmt::format("{}: home_deg is {:g}°, outside the travel {:g} … {:g}°", name,
                    axis.number("home_deg") * in_degrees, least * in_degrees, most * in_degrees));
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
    if (gantry.has("tolerance_deg") && axis->has("min_deg") && axis->has("max_deg")) {
      const double travel = axis->number("max_deg") - axis->number("min_deg");
      if (travel > 0 && gantry.number("tolerance_deg") >= travel)
        findings.error(
            gantry.at("tolerance_deg"),
            fmt::format("gantry.tolerance_deg is {:g}°, as much as the whole travel of "
                        "{}: every move would have arrived",
                        gantry.number("tolerance_deg") * in_degrees, axis->text("name")));
    }
  }
  if (!gantry.has("kinematics") || seen.empty()) return;
  for (const char* name : {"azimuth", "elevation"})
    if (!seen.contains(name))
      findings.error(gantry.place,
                     fmt::format("a dome needs an axis \"{}\": add a [[gantry.axis]] table", name));
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

void check_rig(const Section& root, const ControllerProfile* profile, Findings& findings) {
  if (const Section* camera = root.find("camera")) check_camera(*camera, findings);
  if (const Section* gantry = root.find("gantry")) check_axes(*gantry, findings);
  if (root.find("lamp") != nullptr) check_lamp(root, findings);
  check_backends(root, profile, findings);
  for (const Section* volume : root.all("keep_out")) check_keep_out(*volume, findings);
  if (const Section* candidates = root.find("candidates")) check_candidates(*candidates, findings);
}

}  // namespace lightrig
