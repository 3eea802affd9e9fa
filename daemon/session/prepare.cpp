#include "daemon/session/prepare.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <span>
#include <thread>
#include <utility>

#include "config/load_materials.h"
#include "daemon/session/bin_views.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/plan_shots.h"
#include "drivers/backends.h"

namespace lightrig {

SurfacePoints points_seen(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                          const GantryPosition& position) {
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, position);
  return spec.plan.points == PointSource::pixels
             ? points_of_pixels(prepared.object.mesh, *prepared.occluder, camera,
                                spec.plan.pixel_stride)
             : points_of_vertices(prepared.object.mesh, *prepared.occluder, camera);
}

namespace {

/// Notes how long each stage took, and tells that it is done.
class StageClock {
 public:
  StageClock(std::vector<StageCost>& cost, const Patience& patience)
      : cost_(cost), patience_(patience) {}
  void done(const char* stage) {
    const auto now = std::chrono::steady_clock::now();
    cost_.push_back({stage, std::chrono::duration<double>(now - last_).count()});
    last_ = now;
    patience_.tell();
  }
  const Patience& patience() const { return patience_; }

 private:
  std::vector<StageCost>& cost_;
  const Patience& patience_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// The most memory that this process has held [MiB].
double peak_memory_mib() {
  rusage usage{};
  return getrusage(RUSAGE_SELF, &usage) == 0 ? static_cast<double>(usage.ru_maxrss) / 1024 : 0;
}

int thread_count() { return static_cast<int>(std::max(1U, std::thread::hardware_concurrency())); }

// The condition number weighs every component alike, also those that carry next to nothing: it is
// taken over the components that matter [Ali 2013: K = 45 holds 99.89 % of the variance of MERL].
constexpr Eigen::Index most_condition_components = 45;
constexpr double condition_variance = 0.9989;

/// The first components that hold `condition_variance` of what all of them hold.
Eigen::Index condition_components(const BrdfBasis& basis) {
  const double wanted = condition_variance * basis.stddev.squaredNorm();
  double held = 0;
  Eigen::Index k = 0;
  while (k < basis.components() && held < wanted) {
    held += basis.stddev[k] * basis.stddev[k];
    ++k;
  }
  return std::clamp(k, Eigen::Index{1}, std::min(most_condition_components, basis.components()));
}

Result<void> load(const SessionSpec& spec, Prepared& prepared, StageClock& clock) {
  auto object = load_object(spec.object);
  if (!object) return tl::unexpected(object.error());
  prepared.object = std::move(*object);
  prepared.remarks.push_back(prepared.object.description);
  clock.done("mesh");
  prepared.occluder = std::make_shared<const Occluder>(prepared.object.mesh);
  clock.done("occluder");
  auto loaded = load_materials(spec.materials, clock.patience().beat);
  if (!loaded) return tl::unexpected(loaded.error());
  prepared.materials = std::move(loaded->materials);
  prepared.remarks.insert(prepared.remarks.end(), loaded->remarks.begin(), loaded->remarks.end());
  clock.done("materials");
  return {};
}

std::string describe_source(const MaterialsConfig& materials) {
  const bool builtin = materials.source == "builtin";
  std::string text = builtin ? "built-in set" : "measured materials (MERL files)";
  std::vector<std::string> without = materials.leave_out_families;
  without.insert(without.end(), materials.leave_out.begin(), materials.leave_out.end());
  if (!without.empty()) text += fmt::format(", without {}", fmt::join(without, ", "));
  return text;
}

Result<void> make_bases(const SessionSpec& spec, Prepared& prepared, StageClock& clock) {
  BasisOptions options;
  options.layout = spec.materials.layout;
  options.mapping = spec.materials.mapping;
  options.floor = spec.materials.floor;
  options.components = spec.materials.components;
  options.threads = thread_count();
  auto basis = make_basis(prepared.materials, options);
  if (!basis) return tl::unexpected(basis.error());
  prepared.fit_basis = std::move(*basis);
  prepared.fit_basis.source = describe_source(spec.materials);
  if (!prepared.fit_basis.left_out) {
    prepared.remarks.push_back(fmt::format(
        "{} materials are too few to leave any out and see how the others serve it: the predicted "
        "errors are no experience, but the scatter of these materials taken for what a new one may "
        "differ by. Add materials, of kinds like the one to be measured.",
        prepared.materials.size()));
  }
  prepared.plan_basis = prepared.fit_basis;
  const bool chosen_by_hand = spec.materials.components > 0;
  // Without a prior every component must be seen, so a pseudo-inverse takes as many as the
  // condition number does.
  if (!chosen_by_hand && spec.plan.criterion == Criterion::condition) {
    prepared.plan_basis = truncated(prepared.fit_basis, condition_components(prepared.fit_basis));
  }
  if (!chosen_by_hand && spec.estimator == Estimator::pseudo_inverse) {
    prepared.fit_basis = truncated(prepared.fit_basis, condition_components(prepared.fit_basis));
  }
  if (spec.estimator == Estimator::map) {
    prepared.azimuths = AzimuthModel(prepared.materials, prepared.fit_basis);
  }
  for (Material& material : prepared.materials) material.azimuth.resize(0, 0);  // taken up
  clock.done("basis");
  return {};
}

/// No triangle's front is towards the camera: an open surface, such as a plane, from behind.
bool seen_from_behind(const CameraModel& camera, const Mesh& mesh) {
  for (Eigen::Index i = 0; i < mesh.triangles.cols(); ++i) {
    const Eigen::Vector3i t = mesh.triangles.col(i);
    const Eigen::Vector3d a = mesh.vertices.col(t[0]), b = mesh.vertices.col(t[1]),
                          c = mesh.vertices.col(t[2]);
    if ((b - a).cross(c - a).dot(view_direction(camera, a)) > 0) return false;
  }
  return true;
}

Result<void> look_at_object(const Rig& rig, const SessionSpec& spec, Prepared& prepared,
                            StageClock& clock) {
  const CameraModel& camera = rig.camera.model;
  prepared.points = points_seen(rig, spec, prepared, home_position(rig.gantry.model));
  clock.done("points");
  if (prepared.points.size() > 0) return {};
  const Eigen::Vector3d centre = prepared.object.mesh.vertices.rowwise().mean();
  const Eigen::Vector2d pixel = project(camera, centre);
  if (seen_from_behind(camera, prepared.object.mesh))
    return fail(
        ErrorCode::invalid_input,
        fmt::format("look at the object: every side of it faces away from the camera, which "
                    "sees its back ({}); turn it with [object] rotation_deg, or turn the "
                    "mesh inside out",
                    prepared.object.description));
  const std::string where = pixel.allFinite()
                                ? fmt::format("falls on pixel ({:.0f}, {:.0f}) of {} × {}",
                                              pixel.x(), pixel.y(), camera.width, camera.height)
                                : std::string("lies behind the camera");
  return fail(
      ErrorCode::invalid_input,
      fmt::format("look at the object: the camera sees no point of it ({}; its centre ({:.4g}, "
                  "{:.4g}, {:.4g}) m {}); check [camera] pose and focal length, and [object] "
                  "position, size and unit",
                  prepared.object.description, centre.x(), centre.y(), centre.z(), where));
}

tl::unexpected<Error> nothing_lit(const LeftOut& left_out, std::size_t candidates,
                                  Eigen::Index points) {
  return fail(
      ErrorCode::invalid_input,
      fmt::format(
          "find lamp positions: of {} offered, {} are out of the gantry's travel, at {} lamp "
          "or arm would touch a keep-out volume or what [gantry.body] names, {} show in "
          "the picture, {} shine into the lens, {} stand before the object, and the {} "
          "that are left light none of the {} points the camera sees within the grazing "
          "limits; check [gantry] travel and body, [keep_out] and where the camera looks",
          left_out.candidates_offered, left_out.candidates_unreachable,
          left_out.candidates_touching, left_out.candidates_in_view, left_out.candidates_into_lens,
          left_out.candidates_hiding, candidates, points));
}

Result<void> bin(const Rig& rig, const SessionSpec& spec, bool brute_force, Prepared& prepared,
                 StageClock& clock) {
  LeftOut& left_out = prepared.plan.left_out;
  CandidateLayout layout = lay_candidates(rig, &prepared.object.mesh);
  left_out.candidates_offered = layout.offered;
  left_out.candidates_unreachable = layout.count(NotUsable::unreachable);
  left_out.candidates_touching = layout.count(NotUsable::kept_out);
  left_out.candidates_in_view = layout.count(NotUsable::in_view);
  left_out.candidates_into_lens = layout.count(NotUsable::into_lens);
  left_out.candidates_hiding = layout.count(NotUsable::hides);
  left_out.candidates_kept_out =
      static_cast<int>(layout.unusable.size()) - left_out.candidates_unreachable;
  prepared.candidates = std::move(layout.candidates);
  prepared.unusable = std::move(layout.unusable);
  // The plain reference looks at every point by itself; without shadows, as if nothing cast one.
  std::shared_ptr<const Occluder> standing = prepared.occluder;
  if (brute_force && spec.plan.shadows == ShadowRays::none) {
    Mesh nothing = prepared.object.mesh;
    nothing.triangles.setZero(3, 1);
    prepared.occluder = std::make_shared<const Occluder>(nothing);
  }
  BinningResult binned =
      bin_views(rig, spec, prepared, brute_force ? ShadowRays::all : spec.plan.shadows,
                thread_count(), clock.patience());
  if (prepared.occluder != standing) {  // rays against nothing are none
    binned.statistics.rays_left_out += std::exchange(binned.statistics.rays_cast, 0);
    prepared.occluder = std::move(standing);
  }
  clock.done("bins");
  prepared.bins = std::move(binned.bins);
  left_out.binning = binned.statistics;
  if (prepared.bins.cell.empty()) {
    return nothing_lit(left_out, prepared.candidates.size(), prepared.points.size());
  }
  return {};
}

/// Lights of the candidates not excluded, held-out ones behind them, and the way to all of them.
Result<void> lay_plan(const Rig& rig, const SessionSpec& spec, const SelectionOptions& options,
                      Prepared& prepared, StageClock& clock) {
  const Selection selection = select_lights(prepared.plan_basis, prepared.bins, options);
  clock.done("select");
  Plan& plan = prepared.plan;
  plan.shots.clear();
  plan.mean_only_error_percent = selection.mean_only_error_percent;
  plan.left_out.selection = selection.statistics;
  plan.left_out.lights_not_needed =
      std::max(0, spec.plan.max_lights - static_cast<int>(selection.lights.size()));
  if (selection.lights.empty()) {
    return nothing_lit(plan.left_out, prepared.candidates.size(), prepared.points.size());
  }
  for (const SelectedLight& light : selection.lights) {
    plan.shots.push_back(shot_at(prepared, spec, light));
  }
  for (const int candidate : choose_held_out(prepared, spec, options.excluded)) {
    SelectedLight after_all = selection.lights.back();
    after_all.candidate = candidate;
    after_all.new_cells = 0;
    plan.shots.push_back(shot_at(prepared, spec, after_all));
    plan.shots.back().held_out = true;
  }
  clock.done("held_out");
  plan.visit_order = visiting_order(rig, spec, plan);
  return {};
}

/// The first light of the way that no clear way leads to; −1 where there is none such.
int without_way(const CaptureTime& time) {
  const auto lost = std::ranges::find_if(time.shots, [](const auto& s) { return s.way.empty(); });
  return lost == time.shots.end() ? -1 : lost->shot;
}

Result<void> go_on(const std::stop_token& stop) {
  if (stop.stop_requested()) return fail(ErrorCode::stopped, "plan: stopped on request");
  return {};
}

Result<void> choose_lights(const Rig& rig, const SessionSpec& spec, bool brute_force,
                           Prepared& prepared, StageClock& clock) {
  const std::stop_token& stop = clock.patience().stop;
  constexpr int most_without_way = 50;  // by then it is the home position that is shut in
  SelectionOptions options;
  options.criterion = spec.plan.criterion;
  options.stop = spec.plan.stop;
  options.plateau = spec.plan.plateau;
  options.max_lights = spec.plan.max_lights;
  options.sigma = prepared.plan_basis.model_sigma;
  options.brute_force = brute_force;
  options.threads = thread_count();
  Plan& plan = prepared.plan;
  plan.criterion = spec.plan.criterion;
  plan.stop = spec.plan.stop;
  plan.stop_value = spec.plan.stop == StopRule::plateau ? spec.plan.plateau : spec.plan.max_lights;
  const Mesh* object = &prepared.object.mesh;
  for (int left_out = 0;; ++left_out) {
    if (auto next = go_on(stop); !next) return next;
    if (auto laid = lay_plan(rig, spec, options, prepared, clock); !laid) return laid;
    const CaptureTime time = capture_time(rig, spec, plan, object);
    plan.predicted_capture_time = time.total();
    clock.patience().tell();
    const int shot = without_way(time);
    if (shot < 0 && left_out > 0) {
      prepared.remarks.push_back(fmt::format(
          "{} candidates were chosen and left out again: no way leads to them clear of what the "
          "rig file says that lamp and arm may not touch",
          left_out));
    }
    if (shot < 0) break;
    if (left_out == most_without_way) {
      return fail(ErrorCode::refused,
                  fmt::format("find a way for the lamp: none leads to {} lights chosen one after "
                              "another; give the gantry another home, or check the [keep_out] "
                              "volumes and [gantry.body] of the rig file",
                              left_out));
    }
    options.excluded.resize(prepared.candidates.size(), 0);
    options
        .excluded[static_cast<std::size_t>(plan.shots[static_cast<std::size_t>(shot)].candidate)] =
        1;
  }
  if (auto next = go_on(stop); !next) return next;
  prepared.capture_by_lights = capture_time_by_lights(rig, spec, plan, object);
  clock.done("route");
  return {};
}

/// The sides of a turned object that the plan's shots show.
void see_turned(const Rig& rig, const SessionSpec& spec, const Patience& patience,
                Prepared& prepared) {
  if (!turns_object(rig.gantry.model)) return;
  for (const Shot& shot : prepared.plan.shots) {
    prepared.turned_points.push_back(points_seen(rig, spec, prepared, shot.gantry));
    patience.tell();
  }
}

/// To be heard before anything moves: what may be touched, and that nothing tests the result.
void remark_doubts(const Rig& rig, Prepared& prepared) {
  if (moves_without_body(rig)) prepared.remarks.emplace_back(no_body_remark);
  if (std::ranges::any_of(prepared.plan.shots, &Shot::held_out)) return;
  prepared.remarks.emplace_back(
      "no light is held out: the session will not know its error, only what is predicted of it; "
      "[plan] held_out_lights = 1 captures one that is compared and not fitted");
}

/// Everything but the choice of lights.
Result<Prepared> prepare_scene(const Rig& rig, const SessionSpec& spec, bool brute_force,
                               const Patience& patience) {
  Prepared prepared;
  StageClock clock(prepared.cost, patience);
  const auto next = [&] { return go_on(patience.stop); };
  const auto ready = load(spec, prepared, clock)
                         .and_then(next)
                         .and_then([&] { return make_bases(spec, prepared, clock); })
                         .and_then(next)
                         .and_then([&] { return look_at_object(rig, spec, prepared, clock); })
                         .and_then(next)
                         .and_then([&] { return bin(rig, spec, brute_force, prepared, clock); })
                         .and_then(next);
  if (!ready) return tl::unexpected(ready.error());
  LeftOut& left_out = prepared.plan.left_out;
  left_out.components_available = static_cast<int>(prepared.fit_basis.components());
  left_out.components_used = static_cast<int>(prepared.plan_basis.components());
  left_out.channels_not_needed = 3 - rig.camera.sensor.channels();
  left_out.drivers_not_opened = drivers_not_opened(rig, false);
  return prepared;
}

}  // namespace

const SurfacePoints& points_of_shot(const Prepared& prepared, int shot) {
  return prepared.turned_points.empty() ? prepared.points
                                        : prepared.turned_points[static_cast<std::size_t>(shot)];
}

Result<Prepared> prepare(const Rig& rig, const SessionSpec& spec, bool brute_force,
                         const Patience& patience) {
  auto prepared = prepare_scene(rig, spec, brute_force, patience);
  if (!prepared) return prepared;
  StageClock clock(prepared->cost, patience);
  if (auto chosen = choose_lights(rig, spec, brute_force, *prepared, clock); !chosen) {
    return tl::unexpected(chosen.error());
  }
  see_turned(rig, spec, patience, *prepared);
  remark_doubts(rig, *prepared);
  prepared->peak_memory_mib = peak_memory_mib();
  return prepared;
}

Result<Prepared> prepare_with_plan(const Rig& rig, const SessionSpec& spec, const Plan& plan,
                                   const Patience& patience) {
  auto prepared = prepare_scene(rig, spec, false, patience);
  if (!prepared) return prepared;
  for (const Shot& shot : plan.shots) {
    if (auto usable = check_shot(rig, spec, *prepared, shot); !usable) {
      return tl::unexpected(with_context("use the stored plan", usable.error()));
    }
  }
  prepared->plan = plan;
  // The file holds where a lamp is, the rig how it shines.
  for (Shot& shot : prepared->plan.shots)
    shot.light = prepared->candidates[static_cast<std::size_t>(shot.candidate)].light;
  see_turned(rig, spec, patience, *prepared);
  remark_doubts(rig, *prepared);
  return prepared;
}

}  // namespace lightrig
