#include "daemon/session/replan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/planner.h"
#include "core/route.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/plan_shots.h"

namespace lightrig {
namespace {

/// A bin is had when at least this share of the camera's channels gave a value.
constexpr double enough_channels = 0.5;
/// Share of a light's planned bins that may be lost before the rest of the plan is looked at again.
constexpr double tolerable_loss = 0.1;
/// Relative gain in the criterion for which a reviewed plan is changed.
constexpr double least_gain = 0.02;
/// Share of its planned bins that a light must be missing for whatever stands there to be taken to
/// hide the object, not some bins of it.
constexpr double hides_all = 0.75;
/// [rad] 15°: lights as near as this to one that was blocked are blocked by the same thing.
constexpr double same_shadow = 0.26179938779914943;

std::size_t place(std::int32_t cell) { return static_cast<std::size_t>(cell); }

const LightPosition& light_of(const Prepared& prepared, int candidate) {
  return prepared.candidates[static_cast<std::size_t>(candidate)].light;
}

int candidate_of(const Prepared& prepared, int shot) {
  return prepared.plan.shots[static_cast<std::size_t>(shot)].candidate;
}

/// What the fitted lights say of every cell: its best worth, and whether looking again can help.
struct Known {
  std::vector<double> weight;        ///< (cells)
  std::vector<std::uint8_t> closed;  ///< (cells)
};

Known known_of(const Prepared& prepared, std::span<const LightYield> yields) {
  const auto cells = static_cast<std::size_t>(prepared.bins.grid.cells());
  Known known{std::vector<double>(cells, 0.0), std::vector<std::uint8_t>(cells, 0)};
  for (const LightYield& yield : yields) {
    const bool fitted = !prepared.plan.shots[static_cast<std::size_t>(yield.shot)].held_out;
    for (std::size_t c = 0; c < cells; ++c) {
      if (fitted) known.weight[c] = std::max(known.weight[c], yield.weight[c]);
      if (yield.hopeless[c] != 0 || (fitted && yield.had[c] != 0)) known.closed[c] = 1;
    }
  }
  return known;
}

/// The rows had, each times the root of its worth.
Eigen::MatrixXd rows_had(const BrdfBasis& basis, const std::vector<double>& weight) {
  const int per_cell = basis.layout == ChannelLayout::stacked ? basis.channels : 1;
  const auto count = std::ranges::count_if(weight, [](double w) { return w > 0; });
  Eigen::MatrixXd rows(count * per_cell, basis.components());
  Eigen::Index row = 0;
  for (std::size_t c = 0; c < weight.size(); ++c) {
    if (!(weight[c] > 0)) continue;
    for (int channel = 0; channel < per_cell; ++channel) {
      rows.row(row++) = std::sqrt(weight[c]) * basis.V.row(basis.row(static_cast<int>(c), channel));
    }
  }
  return rows;
}

/// The bins that candidates can still be counted on for.
CandidateBins bins_left(const Prepared& prepared, const Known& known,
                        std::span<const LightYield> yields) {
  const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
  CandidateBins left;
  left.grid = prepared.bins.grid;
  left.offset.push_back(0);
  for (int i = 0; i < prepared.bins.candidates(); ++i) {
    std::vector<const LightYield*> beside;
    bool hidden = false;
    for (const LightYield& yield : yields) {
      const LightPosition& lost = light_of(prepared, candidate_of(prepared, yield.shot));
      if (yield.missing > 0 && angle_between(lost, light_of(prepared, i), middle) <= same_shadow) {
        beside.push_back(&yield);
        // The bins of a neighbour are mostly others, and as hidden as those that were lost.
        hidden = hidden || yield.missing > hides_all * yield.planned;
      }
    }
    for (const std::int32_t cell : prepared.bins.of(i)) {
      const bool blocked = hidden || std::ranges::any_of(beside, [&](const LightYield* yield) {
                             return yield->absent[place(cell)] != 0;
                           });
      if (!blocked && known.closed[place(cell)] == 0) left.cell.push_back(cell);
    }
    left.offset.push_back(static_cast<std::int64_t>(left.cell.size()));
  }
  return left;
}

/// Candidates that may not be chosen: what the plan has already but for the open lights, and what
/// stands near a light that is to test the result.
std::vector<std::uint8_t> excluded(const Prepared& prepared, const std::vector<int>& open) {
  const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
  std::vector<std::uint8_t> out(prepared.candidates.size(), 0);
  for (std::size_t s = 0; s < prepared.plan.shots.size(); ++s) {
    const Shot& shot = prepared.plan.shots[s];
    if (std::ranges::count(open, static_cast<int>(s)) > 0) continue;
    out[static_cast<std::size_t>(shot.candidate)] = 1;
    if (!shot.held_out) continue;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (angle_between(shot.light, prepared.candidates[i].light, middle) < held_out_distance) {
        out[i] = 1;
      }
    }
  }
  // What was planned near a held-out light for want of others may stay.
  for (const int shot : open) out[static_cast<std::size_t>(candidate_of(prepared, shot))] = 0;
  return out;
}

bool better(Criterion criterion, const SelectedLight& is, const SelectedLight& was) {
  if (criterion == Criterion::condition && is.rank != was.rank) return is.rank > was.rank;
  return is.score <= (1 - least_gain) * was.score;
}

}  // namespace

LightYield yield_of(const Prepared& prepared, int shot, const BrdfObservations& observed,
                    int channels) {
  const BrdfBasis& basis = prepared.plan_basis;
  const auto cells = static_cast<std::size_t>(basis.grid.cells());
  const double model = basis.model_sigma * basis.model_sigma;
  LightYield yield;
  yield.shot = shot;
  yield.weight.assign(cells, 0.0);
  yield.hopeless.assign(cells, 0);
  yield.absent.assign(cells, 0);
  yield.had.assign(cells, 0);
  std::vector<int> values(cells, 0);
  std::vector<std::uint8_t> bright(cells, 0), there(cells, 0);
  // Black may be the material or something in the way, and where that is, so may be dark: from
  // elsewhere it is worth another look.
  const bool in_the_way = !observed.black.empty();
  for (const BrdfObservation& row : observed.rows) {
    const std::size_t c = place(row.cell);
    if (row.kind == BrdfObservation::Kind::below && in_the_way) continue;
    there[c] = 1;
    if (row.kind == BrdfObservation::Kind::above) bright[c] = 1;
    if (row.kind != BrdfObservation::Kind::value) continue;
    const double slope = map_slope(basis.mapping, row.cell, std::max(row.f, basis.mapping.floor));
    yield.weight[c] += model / (model + row.variance * slope * slope) / channels;
    yield.had[c] = ++values[c] >= enough_channels * channels ? 1 : 0;
  }
  for (const std::int32_t cell : prepared.bins.of(candidate_of(prepared, shot))) {
    const std::size_t c = place(cell);
    ++yield.planned;
    if (values[c] > 0) continue;
    if (there[c] == 0) {
      ++yield.missing;
      yield.absent[c] = 1;
    } else {
      ++(bright[c] != 0 ? yield.saturated : yield.dark);
      yield.hopeless[c] = 1;
    }
  }
  return yield;
}

bool lost_rows(const LightYield& yield) { return yield.lost() > tolerable_loss * yield.planned; }

std::optional<Replan> replan(const Prepared& prepared, const SessionSpec& spec,
                             std::span<const LightYield> yields, const ReplanQuestion& question,
                             int threads) {
  yields = yields.first(question.yields);
  if (yields.empty() || question.open.empty() || !lost_rows(yields.back())) return std::nullopt;
  const Known known = known_of(prepared, yields);
  const CandidateBins bins = bins_left(prepared, known, yields);
  if (bins.cell.empty()) return std::nullopt;
  SelectionOptions options;
  options.criterion = spec.plan.criterion;
  options.stop = StopRule::count;
  options.max_lights = static_cast<int>(question.open.size());
  options.sigma = prepared.plan_basis.model_sigma;
  options.threads = threads;
  options.had = rows_had(prepared.plan_basis, known.weight);
  options.excluded = excluded(prepared, question.open);
  for (const int shot : question.in_hand) {
    options.already.push_back(candidate_of(prepared, shot));
  }
  SelectionOptions as_planned = options;
  for (const int shot : question.open) {
    as_planned.already.push_back(candidate_of(prepared, shot));
  }
  LightPlanner planner(prepared.plan_basis, bins, options);
  const SelectedLight was = planner.judge(as_planned);
  const Selection chosen = planner.select(options);
  if (chosen.lights.size() < question.open.size() ||
      !better(options.criterion, chosen.lights.back(), was)) {
    return std::nullopt;
  }
  Replan found{{}, was.predicted_error_percent, chosen.lights.back().predicted_error_percent};
  for (std::size_t i = 0; i < question.open.size(); ++i) {
    found.lights.emplace_back(question.open[i], chosen.lights[i]);
  }
  return found;
}

void take_up(const Rig& rig, const SessionSpec& spec, const Replan& changes,
             std::span<const int> done, Prepared& prepared) {
  Plan& plan = prepared.plan;
  for (const auto& [index, selected] : changes.lights) {
    const auto at = static_cast<std::size_t>(index);
    plan.shots[at] = shot_at(prepared, spec, selected);
    if (!prepared.turned_points.empty()) {
      prepared.turned_points[at] = points_seen(rig, spec, prepared, plan.shots[at].gantry);
    }
  }
  std::vector<int> left;
  std::vector<GantryPosition> stops;
  const std::vector<int> before =
      may_stop_early(spec) ? visiting_order(rig, spec, plan) : plan.visit_order;
  for (const int index : before) {
    if (std::ranges::count(done, index) > 0) continue;
    left.push_back(index);
    stops.push_back(plan.shots[static_cast<std::size_t>(index)].gantry);
  }
  plan.visit_order.assign(done.begin(), done.end());
  if (may_stop_early(spec) || done.empty()) {
    plan.visit_order.insert(plan.visit_order.end(), left.begin(), left.end());
  } else {
    const GantryPosition& here = plan.shots[static_cast<std::size_t>(done.back())].gantry;
    for (const int stop : order_route(rig.gantry.model, here, stops)) {
      plan.visit_order.push_back(left[static_cast<std::size_t>(stop)]);
    }
  }
  plan.predicted_capture_time = capture_time(rig, spec, plan, &prepared.object.mesh).total();
}

std::string describe(const LightYield& yield) {
  return fmt::format("{} of {} bins lost ({} blocked or mixed, {} too bright, {} too dark)",
                     yield.lost(), yield.planned, yield.missing, yield.saturated, yield.dark);
}

}  // namespace lightrig
