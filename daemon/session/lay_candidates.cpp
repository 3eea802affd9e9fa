#include "daemon/session/lay_candidates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/keep_out.h"

namespace lightrig {
namespace {

/// Where the rule's direction puts a near lamp.
Eigen::Vector3d lamp_point(const DomeKinematics& dome, const Eigen::Vector3d& direction) {
  return dome.centre + dome.radius * direction;
}

std::vector<Eigen::Vector3d> offers(const Rig& rig) {
  const CandidateRule& rule = rig.candidates;
  if (rule.kind == CandidateRule::Kind::list) return rule.list;
  std::vector<Eigen::Vector3d> points = fibonacci_sphere(rule.count);
  if (rig.gantry.model.distant_lamp) return points;
  for (Eigen::Vector3d& point : points) {
    point = std::visit([&](const auto& kinematics) { return lamp_point(kinematics, point); },
                       rig.gantry.model.kinematics);
  }
  return points;
}

Solid solid_of(const KeepOutSphere& sphere) { return Ball{sphere.centre, sphere.radius}; }
Solid solid_of(const KeepOutBox& box) { return Box{box.min, box.max}; }

std::vector<Solid> solids_of(const std::vector<KeepOut>& volumes) {
  std::vector<Solid> solids;
  for (const KeepOut& volume : volumes) {
    solids.push_back(std::visit([](const auto& shape) { return solid_of(shape); }, volume));
  }
  return solids;
}

std::string name_of_volume(const KeepOut& volume) {
  return std::visit([](const auto& shape) { return shape.name; }, volume);
}

bool in_the_picture(const CameraModel& camera, const LightPosition& light) {
  if (light.distant) return false;
  const Eigen::Vector2d pixel = project(camera, light.p);
  return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() <= camera.width - 0.5 &&
         pixel.y() <= camera.height - 0.5;
}

}  // namespace

std::vector<Eigen::Vector3d> fibonacci_sphere(int count) {
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Eigen::Vector3d> directions;
  directions.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2.0 * i + 1) / count;
    const double r = std::sqrt(std::max(0.0, 1 - z * z));
    const double azimuth = golden_angle * i;
    directions.emplace_back(r * std::cos(azimuth), r * std::sin(azimuth), z);
  }
  return directions;
}

std::string keep_out_at(const Rig& rig, const LightPosition& light) {
  if (light.distant) return {};
  const Capsule lamp{light.p, light.p, 0};
  for (const KeepOut& volume : rig.keep_out) {
    const Solid solid = std::visit([](const auto& shape) { return solid_of(shape); }, volume);
    if (clearance(lamp, solid) <= 0) return name_of_volume(volume);
  }
  return {};
}

CandidateLayout lay_candidates(const Rig& rig) {
  CandidateLayout layout;
  for (const Eigen::Vector3d& p : offers(rig)) {
    ++layout.offered;
    const auto gantry = reach(rig.gantry.model, p);
    if (!gantry) {
      ++layout.unreachable;
      continue;
    }
    const LightPosition light = light_at(rig.gantry.model, *gantry);
    if (!keep_out_at(rig, light).empty() || in_the_picture(rig.camera.model, light)) {
      ++layout.kept_out;
      continue;
    }
    layout.candidates.push_back({light, *gantry});
  }
  return layout;
}

std::string obstacle_on_the_way(const Rig& rig, const GantryPosition& from,
                                const GantryPosition& to) {
  const GantryModel& gantry = rig.gantry.model;
  if (!within_limits(gantry, to)) return "the end of travel";
  const auto contact = first_contact(gantry, GantryBody{}, from, to, solids_of(rig.keep_out), 0);
  return contact ? name_of_volume(rig.keep_out[contact->volume]) : std::string();
}

Result<std::vector<GantryPosition>> clear_way(const Rig& rig,
                                              const std::vector<Candidate>& candidates,
                                              const GantryPosition& from,
                                              const GantryPosition& to) {
  const std::string obstacle = obstacle_on_the_way(rig, from, to);
  if (obstacle.empty()) return std::vector<GantryPosition>{to};
  const GantryModel& gantry = rig.gantry.model;
  double best_time = std::numeric_limits<double>::infinity();
  const GantryPosition* best = nullptr;
  for (const Candidate& via : candidates) {
    const double time = move_time(gantry, from, via.gantry) + move_time(gantry, via.gantry, to);
    if (time < best_time && obstacle_on_the_way(rig, from, via.gantry).empty() &&
        obstacle_on_the_way(rig, via.gantry, to).empty()) {
      best_time = time;
      best = &via.gantry;
    }
  }
  if (best == nullptr) {
    return fail(ErrorCode::refused,
                fmt::format("find a way for the lamp: the direct one meets {}, and no candidate "
                            "position leads around it; give the gantry another home, or check the "
                            "[keep_out] volumes of the rig file",
                            obstacle));
  }
  return std::vector<GantryPosition>{*best, to};
}

GantryPosition home_position(const GantryModel& gantry) {
  GantryPosition home;
  home.axes.resize(static_cast<Eigen::Index>(gantry.axes.size()));
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    home.axes[static_cast<Eigen::Index>(i)] = gantry.axes[i].home;
  }
  return home;
}

}  // namespace lightrig
