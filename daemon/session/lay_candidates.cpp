#include "daemon/session/lay_candidates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

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

bool holds(const KeepOutSphere& sphere, const Eigen::Vector3d& p) {
  return (p - sphere.centre).norm() <= sphere.radius;
}
bool holds(const KeepOutBox& box, const Eigen::Vector3d& p) {
  return (p.array() >= box.min.array()).all() && (p.array() <= box.max.array()).all();
}

bool in_the_picture(const CameraModel& camera, const LightPosition& light) {
  if (light.distant) return false;
  const Eigen::Vector2d pixel = project(camera, light.p);
  return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() <= camera.width - 0.5 &&
         pixel.y() <= camera.height - 0.5;
}

/// Reach of the arm [m], to turn a rotation into a length.
double arm_length(const DomeKinematics& dome) { return dome.radius; }

/// Least step along the lamp's path at which obstacles are looked for [m].
constexpr double way_step = 0.005;

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
  for (const KeepOut& keep_out : rig.keep_out) {
    if (std::visit([&](const auto& shape) { return holds(shape, light.p); }, keep_out)) {
      return std::visit([](const auto& shape) { return shape.name; }, keep_out);
    }
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
  if (rig.keep_out.empty()) return {};
  double length = 0;  // an upper bound on the lamp's path [m]
  const double arm = std::visit([](const auto& k) { return arm_length(k); }, gantry.kinematics);
  for (Eigen::Index i = 0; i < to.axes.size(); ++i) {
    const bool rotary = gantry.axes[static_cast<std::size_t>(i)].rotary;
    length += std::abs(to.axes[i] - from.axes[i]) * (rotary ? arm : 1.0);
  }
  // move_position() follows the speed profile: even steps in time are never longer than twice the
  // mean step.
  const double duration = move_time(gantry, from, to);
  const int steps = 2 * static_cast<int>(std::ceil(length / way_step)) + 1;
  for (int i = 0; i <= steps; ++i) {
    const GantryPosition at = move_position(gantry, from, to, duration * i / steps);
    // The lamp's own place, even where the light counts as distant.
    GantryModel near = gantry;
    near.distant_lamp = false;
    if (std::string name = keep_out_at(rig, light_at(near, at)); !name.empty()) return name;
  }
  return {};
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
