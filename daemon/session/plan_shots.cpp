#include "daemon/session/plan_shots.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/planner.h"
#include "core/route.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/split_mix.h"

namespace lightrig {

double angle_between(const LightPosition& a, const LightPosition& b,
                     const Eigen::Vector3d& middle) {
  const Eigen::Vector3d u = a.direction_from(middle), v = b.direction_from(middle);
  return 2 * std::asin(std::min(1.0, 0.5 * (u - v).norm()));
}

Shot shot_at(const Prepared& prepared, const SessionSpec& spec, const SelectedLight& selected) {
  const Candidate& candidate = prepared.candidates[static_cast<std::size_t>(selected.candidate)];
  Shot shot;
  shot.candidate = selected.candidate;
  shot.light = candidate.light;
  shot.gantry = candidate.gantry;
  shot.exposures = spec.bracket.exposures;
  shot.selection = selected;
  return shot;
}

bool may_stop_early(const SessionSpec& spec) {
  return spec.stop.predicted_error_percent || spec.stop.minutes || spec.stop.lights;
}

std::vector<int> visiting_order(const Rig& rig, const SessionSpec& spec, const Plan& plan) {
  std::vector<int> order;
  if (may_stop_early(spec)) {
    for (const bool held_out : {true, false}) {
      for (std::size_t i = 0; i < plan.shots.size(); ++i) {
        if (plan.shots[i].held_out == held_out) order.push_back(static_cast<int>(i));
      }
    }
    return order;
  }
  std::vector<GantryPosition> stops;
  for (const Shot& shot : plan.shots) stops.push_back(shot.gantry);
  return order_route(rig.gantry.model, home_position(rig.gantry.model), stops);
}

std::vector<int> choose_held_out(const Prepared& prepared, const SessionSpec& spec,
                                 std::span<const std::uint8_t> excluded) {
  const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
  std::vector<int> taken;
  for (const Shot& shot : prepared.plan.shots) taken.push_back(shot.candidate);
  std::size_t richest = 0;
  const int count = prepared.bins.candidates();
  for (int i = 0; i < count; ++i) richest = std::max(richest, prepared.bins.of(i).size());
  const auto light = [&](int i) { return prepared.candidates[static_cast<std::size_t>(i)].light; };
  std::vector<int> held_out;
  while (static_cast<int>(held_out.size()) < spec.plan.held_out_lights) {
    std::vector<int> clear, near;
    for (int i = 0; i < count; ++i) {
      if (2 * prepared.bins.of(i).size() < richest || std::ranges::count(taken, i) > 0) continue;
      if (!excluded.empty() && excluded[static_cast<std::size_t>(i)] != 0) continue;
      const bool far = std::ranges::all_of(taken, [&](int other) {
        return angle_between(light(i), light(other), middle) >= held_out_distance;
      });
      (far ? clear : near).push_back(i);
    }
    const std::vector<int>& offered = clear.empty() ? near : clear;
    if (offered.empty()) break;
    const std::uint64_t draw = split_mix(split_mix(spec.plan.seed) + held_out.size());
    held_out.push_back(offered[draw % offered.size()]);
    taken.push_back(held_out.back());
  }
  return held_out;
}

std::vector<double> predicted_on_the_way(const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  CandidateBins bins;  // of the way's shots alone, in its order
  bins.grid = prepared.bins.grid;
  bins.offset.push_back(0);
  for (const int index : plan.visit_order) {
    const auto cells = prepared.bins.of(plan.shots[static_cast<std::size_t>(index)].candidate);
    bins.cell.insert(bins.cell.end(), cells.begin(), cells.end());
    bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  }
  SelectionOptions options;
  options.criterion = Criterion::a_optimal;  // the posterior is what the prediction is made of
  options.sigma = prepared.plan_basis.model_sigma;
  LightPlanner planner(prepared.plan_basis, bins, options);
  std::vector<double> percent;
  double last = plan.mean_only_error_percent;
  for (std::size_t i = 0; i < plan.visit_order.size(); ++i) {
    if (!plan.shots[static_cast<std::size_t>(plan.visit_order[i])].held_out) {
      options.already.push_back(static_cast<int>(i));
      last = planner.judge(options).predicted_error_percent;
    }
    percent.push_back(last);
  }
  return percent;
}

Result<void> check_shot(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                        const Shot& shot) {
  constexpr double nowhere = 1e-9, off = 1e-6;  // relative to the distance of the lamp
  const auto index = static_cast<std::size_t>(shot.candidate);
  if (index >= prepared.candidates.size() ||
      (prepared.candidates[index].light.p - shot.light.p).norm() > nowhere * shot.light.p.norm()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("candidate {} of this rig is not where the plan has it; the plan was "
                            "made for another rig file: plan again",
                            shot.candidate));
  }
  const bool right_axes = within_limits(rig.gantry.model, shot.gantry) &&
                          (light_at(rig.gantry.model, shot.gantry).p - shot.light.p).norm() <=
                              off * shot.light.p.norm();
  if (!right_axes) {
    return fail(ErrorCode::invalid_input,
                fmt::format("its gantry_axes for candidate {} do not put the lamp at its own "
                            "position; the file was changed: plan again",
                            shot.candidate));
  }
  for (const double exposure : shot.exposures) {
    if (std::ranges::find(spec.bracket.exposures, exposure) == spec.bracket.exposures.end()) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("candidate {} asks for an exposure of {} s, which [bracket] does "
                              "not offer: plan again with this session's bracket",
                              shot.candidate, exposure));
    }
  }
  return {};
}

}  // namespace lightrig
