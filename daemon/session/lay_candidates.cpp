#include "daemon/session/lay_candidates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

namespace lightrig {
namespace {

/// One position of the rule: a place for the lamp, or axis values.
struct Offer {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  // in light_at()'s frame
  std::optional<GantryPosition> axes;
};

/// Evenly spaced values over an axis' travel, ends included; a whole turn's ends are one place.
std::vector<double> spaced(const Axis& axis, int count) {
  const double travel = axis.max - axis.min;
  const bool whole_turn = axis.rotary && travel >= 2 * std::numbers::pi - 1e-6;
  std::vector<double> values;
  for (int i = 0; i < count; ++i) {
    const double share = count == 1   ? 0.5
                         : whole_turn ? static_cast<double>(i) / count
                                      : static_cast<double>(i) / (count - 1);
    values.push_back(std::min(axis.max, axis.min + share * travel));
  }
  return values;
}

/// Every combination of the values of the first axes; the last axis changes fastest.
std::vector<AxisValues> combinations(const std::vector<std::vector<double>>& values) {
  std::vector<AxisValues> all{AxisValues(0)};
  for (const std::vector<double>& axis : values) {
    std::vector<AxisValues> longer;
    for (const AxisValues& begun : all) {
      for (const double value : axis) {
        AxisValues one = begun;
        one.conservativeResize(begun.size() + 1);
        one[begun.size()] = value;
        longer.push_back(one);
      }
    }
    all = std::move(longer);
  }
  return all;
}

std::vector<Offer> grid_offers(const Rig& rig) {
  const GantryModel& gantry = rig.gantry.model;
  std::vector<std::vector<double>> values;
  for (std::size_t i = 0; i < rig.candidates.steps.size(); ++i)
    values.push_back(spaced(gantry.axes[i], rig.candidates.steps[i]));
  std::vector<Offer> offers;
  for (const AxisValues& axes : combinations(values)) {
    const auto* cartesian = std::get_if<CartesianKinematics>(&gantry.kinematics);
    if (cartesian != nullptr && cartesian->head) {
      offers.push_back({cartesian->origin + axes.head<3>(), std::nullopt});  // the head is turned
    } else {
      offers.push_back({Eigen::Vector3d::Zero(), GantryPosition{axes}});
    }
  }
  return offers;
}

/// What the sphere of directions is laid about.
struct Sphere {
  Eigen::Vector3d centre;
  double radius;
};
Sphere sphere_of(const DomeKinematics& dome, const CandidateRule&) {
  return {dome.centre, dome.radius};
}
Sphere sphere_of(const CartesianKinematics&, const CandidateRule& rule) {
  return {rule.centre, rule.radius};
}
Sphere sphere_of(const TurntableKinematics& table, const CandidateRule&) {
  return {table.centre, table.radius};
}
Sphere sphere_of(const FixedLampsKinematics& fixed, const CandidateRule&) {
  return {fixed.centre, 0};
}

std::vector<Offer> offers(const Rig& rig) {
  const CandidateRule& rule = rig.candidates;
  const GantryModel& gantry = rig.gantry.model;
  std::vector<Offer> offers;
  if (const auto* fixed = std::get_if<FixedLampsKinematics>(&gantry.kinematics)) {
    for (std::size_t i = 0; i < fixed->lamps.size(); ++i) {
      GantryPosition lamp;
      lamp.axes = Eigen::Matrix<double, 1, 1>(static_cast<double>(i));
      offers.push_back({Eigen::Vector3d::Zero(), lamp});
    }
    return offers;
  }
  if (rule.kind == CandidateRule::Kind::grid) return grid_offers(rig);
  if (rule.kind == CandidateRule::Kind::list) {
    for (const Eigen::Vector3d& p : rule.list) offers.push_back({p, std::nullopt});
    return offers;
  }
  const Sphere sphere = std::visit(
      [&](const auto& kinematics) { return sphere_of(kinematics, rule); }, gantry.kinematics);
  for (const Eigen::Vector3d& direction : fibonacci_sphere(rule.count)) {
    offers.push_back({gantry.distant_lamp ? direction : sphere.centre + sphere.radius * direction,
                      std::nullopt});
  }
  return offers;
}

Solid solid_of(const KeepOutSphere& sphere) { return Ball{sphere.centre, sphere.radius}; }
Solid solid_of(const KeepOutBox& box) { return Box{box.min, box.max}; }

std::string name_of_volume(const KeepOut& volume) {
  return std::visit([](const auto& shape) { return shape.name; }, volume);
}

/// The box around an object, or around the drum that it sweeps on a turntable.
Box box_around(const GantryModel& gantry, const Mesh& object) {
  Box box{object.vertices.rowwise().minCoeff(), object.vertices.rowwise().maxCoeff()};
  if (const auto* table = std::get_if<TurntableKinematics>(&gantry.kinematics)) {
    const Eigen::Matrix3Xd arms = object.vertices.colwise() - table->centre;
    const double reach = arms.topRows<2>().colwise().norm().maxCoeff();
    box.min.head<2>() = table->centre.head<2>().array() - reach;
    box.max.head<2>() = table->centre.head<2>().array() + reach;
  }
  return box;
}

/// A row of balls from the lens backwards, no gap between them deeper than a tenth of their radius.
void add_camera(const Rig& rig, Obstacles& obstacles) {
  const GantrySolid& solid = *rig.gantry.solid;
  if (!(solid.camera_radius > 0)) return;
  const Eigen::Isometry3d world_from_camera = rig.camera.model.camera_from_world.inverse();
  const double step = 0.8 * solid.camera_radius;
  const int balls = 1 + static_cast<int>(std::ceil(solid.camera_length / step));
  for (int i = 0; i < balls; ++i) {
    const double back = balls == 1 ? 0 : solid.camera_length * i / (balls - 1);
    obstacles.solids.push_back(
        Ball{world_from_camera * Eigen::Vector3d(0, 0, -back), 1.1 * solid.camera_radius});
    obstacles.names.emplace_back("the camera");
  }
}

/// [rad] about the line of sight; light from within reaches the glass.
double lens_cone(const CameraConfig& camera) {
  if (camera.lens_cone) return *camera.lens_cone;
  const CameraModel& m = camera.model;
  if (distant(m)) return 0;  // a parallel view says nothing of its lens
  const double half_diagonal = std::atan(std::hypot(m.width / m.fx, m.height / m.fy) / 2);
  return half_diagonal + 5 * std::numbers::pi / 180;
}

bool point_in_picture(const CameraModel& camera, const LightPosition& light) {
  if (light.distant) return false;
  const Eigen::Vector2d pixel = project(camera, light.p);
  return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() <= camera.width - 0.5 &&
         pixel.y() <= camera.height - 0.5;
}

/// What speaks against a position within travel, or empty.
std::optional<NotUsable> objection(const Rig& rig, const Obstacles& obstacles,
                                   const std::optional<Box>& object, const GantryPosition& position,
                                   const LightPosition& light) {
  const GantryModel& gantry = rig.gantry.model;
  const CameraModel camera = camera_at(gantry, rig.camera.model, position);
  // A distant lamp's place is known only where a body is described.
  const bool placed = !gantry.distant_lamp || rig.gantry.solid;
  const bool touches =
      placed &&
      clearance(gantry, obstacles.body, position, obstacles.solids).distance <= obstacles.margin;
  if (touches) return NotUsable::kept_out;
  if (point_in_picture(camera, light)) return NotUsable::in_view;
  if (rig.gantry.solid) {
    const std::vector<Capsule> parts = body_at(gantry, obstacles.body, position);
    if (in_view(rig.camera.model, parts.front())) return NotUsable::in_view;
    const bool hidden = object && std::ranges::any_of(parts, [&](const Capsule& part) {
                          return hides(rig.camera.model, part, *object);
                        });
    if (hidden) return NotUsable::hides;
  }
  if (shines_into_lens(camera, light, lens_cone(rig.camera))) return NotUsable::into_lens;
  return std::nullopt;
}

}  // namespace

std::string text_of(NotUsable why) {
  switch (why) {
    case NotUsable::unreachable:
      return "out of the gantry's travel";
    case NotUsable::kept_out:
      return "lamp or arm would touch something";
    case NotUsable::in_view:
      return "the lamp would show in the picture";
    case NotUsable::into_lens:
      return "the lamp would shine into the lens";
    case NotUsable::hides:
      break;
  }
  return "lamp or arm would stand before the object";
}

int CandidateLayout::count(NotUsable why) const {
  return static_cast<int>(std::ranges::count(unusable, why, &UnusableCandidate::why));
}

bool moves_without_body(const Rig& rig) {
  if (rig.gantry.solid || std::holds_alternative<SimulatedGantry>(rig.gantry.backend)) return false;
  const auto* table = std::get_if<TurntableKinematics>(&rig.gantry.model.kinematics);
  return table != nullptr
             ? table->arm
             : !std::holds_alternative<FixedLampsKinematics>(rig.gantry.model.kinematics);
}

Obstacles obstacles_of(const Rig& rig, const Mesh* object) {
  Obstacles obstacles;
  for (const KeepOut& volume : rig.keep_out) {
    obstacles.solids.push_back(
        std::visit([](const auto& shape) { return solid_of(shape); }, volume));
    obstacles.names.push_back(name_of_volume(volume));
  }
  if (!rig.gantry.solid) return obstacles;
  const GantrySolid& solid = *rig.gantry.solid;
  obstacles.body = solid.body;
  obstacles.margin = solid.margin;
  add_camera(rig, obstacles);
  if (solid.floor) {
    constexpr double far = 1e3;
    obstacles.solids.push_back(Box{{-far, -far, -far}, {far, far, *solid.floor}});
    obstacles.names.emplace_back("the floor");
  }
  if (object != nullptr && object->vertices.cols() > 0) {
    obstacles.solids.push_back(box_around(rig.gantry.model, *object));
    obstacles.names.emplace_back("the object");
  }
  return obstacles;
}

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

CandidateLayout lay_candidates(const Rig& rig, const Mesh* object) {
  const GantryModel& gantry = rig.gantry.model;
  const Obstacles obstacles = obstacles_of(rig, object);
  std::optional<Box> around;
  if (object != nullptr && object->vertices.cols() > 0) around = box_around(gantry, *object);
  CandidateLayout layout;
  for (const Offer& offer : offers(rig)) {
    ++layout.offered;
    const auto position = offer.axes ? offer.axes : reach(gantry, offer.p);
    if (!position || !within_limits(gantry, *position)) {
      layout.unusable.push_back(
          {{.distant = gantry.distant_lamp, .p = offer.p}, NotUsable::unreachable});
      continue;
    }
    const LightPosition light = light_at(gantry, *position);
    if (const auto why = objection(rig, obstacles, around, *position, light)) {
      layout.unusable.push_back({light, *why});
      continue;
    }
    layout.candidates.push_back({light, *position});
  }
  return layout;
}

std::string obstacle_on_the_way(const Rig& rig, const Obstacles& obstacles,
                                const GantryPosition& from, const GantryPosition& to) {
  const GantryModel& gantry = rig.gantry.model;
  if (!within_limits(gantry, to)) return "the end of travel";
  const auto contact =
      first_contact(gantry, obstacles.body, from, to, obstacles.solids, obstacles.margin);
  return contact ? obstacles.names[contact->volume] : std::string();
}

Result<std::vector<GantryPosition>> clear_way(const Rig& rig, const Obstacles& obstacles,
                                              const std::vector<Candidate>& candidates,
                                              const GantryPosition& from,
                                              const GantryPosition& to) {
  const std::string obstacle = obstacle_on_the_way(rig, obstacles, from, to);
  if (obstacle.empty()) return std::vector<GantryPosition>{to};
  const GantryModel& gantry = rig.gantry.model;
  double best_time = std::numeric_limits<double>::infinity();
  const GantryPosition* best = nullptr;
  for (const Candidate& via : candidates) {
    const double time = move_time(gantry, from, via.gantry) + move_time(gantry, via.gantry, to);
    if (time < best_time && obstacle_on_the_way(rig, obstacles, from, via.gantry).empty() &&
        obstacle_on_the_way(rig, obstacles, via.gantry, to).empty()) {
      best_time = time;
      best = &via.gantry;
    }
  }
  if (best == nullptr) {
    return fail(ErrorCode::refused,
                fmt::format("find a way for the lamp: the direct one meets {}, and no candidate "
                            "position leads around it; give the gantry another home, or check the "
                            "[keep_out] volumes and [gantry.body] of the rig file",
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
