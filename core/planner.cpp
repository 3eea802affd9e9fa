#include "core/planner.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/planner_chooser.h"
#include "core/planner_rows.h"

namespace lightrig {

namespace {

std::vector<std::int32_t> marked(const std::vector<std::uint8_t>& seen) {
  std::vector<std::int32_t> cells;
  for (std::size_t c = 0; c < seen.size(); ++c) {
    if (seen[c] != 0) cells.push_back(static_cast<std::int32_t>(c));
  }
  return cells;
}

/// 100·√trace/‖E ln f‖: METHOD's percentage error that a posterior of this trace leads one to
/// expect. Both are sums over the same rows, so channels as columns cancel.
double percent_of_trace(const BrdfBasis& basis, double trace) {
  const double norm = basis.mean.norm();
  return norm > 0 ? 100 * std::sqrt(trace) / norm : 0;
}

/// Whether a standing is worth its light after the one before, under the rule.
bool worth_taking(const SelectionOptions& options, const Standing& before, const Standing& next) {
  if (options.stop == StopRule::count || before.candidate < 0) return true;
  if (next.rank != before.rank) return next.rank > before.rank;
  if (options.stop == StopRule::literal) return next.score < before.score;
  return next.score <= (1 - options.plateau) * before.score;
}

SelectedLight reported(const BrdfBasis& basis, const LightChooser& chooser,
                       const Standing& standing, int new_cells, const SelectionOptions& options) {
  const Eigen::MatrixXd G = CellRows(basis).gather(marked(chooser.seen()));
  const Conditioning found = conditioning_of(singular_values(G), G.rows(), G.cols());
  SelectedLight light;
  light.candidate = standing.candidate;
  light.condition = found.condition;
  light.rank = found.rank;
  light.score = standing.score;
  light.new_cells = new_cells;
  light.predicted_error_percent =
      percent_of_trace(basis, posterior_trace(basis.stddev, G, options.sigma));
  return light;
}

/// How the lights captured already stand: what the first new one is measured against.
Standing standing_of_already(const BrdfBasis& basis, const LightChooser& chooser,
                             const SelectionOptions& options) {
  if (options.already.empty()) return {};
  const Eigen::MatrixXd G = CellRows(basis).gather(marked(chooser.seen()));
  if (G.rows() == 0) return {};
  if (options.criterion == Criterion::a_optimal) {
    return {options.already.back(), 0, posterior_trace(basis.stddev, G, options.sigma)};
  }
  const Conditioning found = conditioning_of(singular_values(G), G.rows(), G.cols());
  return {options.already.back(), found.rank, found.pseudo_condition};
}

std::unique_ptr<LightChooser> make_chooser(const BrdfBasis& basis, const CandidateBins& bins,
                                           const SelectionOptions& options) {
  if (options.brute_force) return make_plain_chooser(basis, bins, options);
  if (options.criterion == Criterion::condition) {
    return make_condition_chooser(basis, bins, options);
  }
  return make_plain_chooser(basis, bins, options);
}

}  // namespace

Selection select_lights(const BrdfBasis& basis, const CandidateBins& bins,
                        const SelectionOptions& options) {
  const auto candidates = static_cast<std::size_t>(bins.candidates());
  CHECK(basis.grid == bins.grid);
  CHECK(options.excluded.empty() || options.excluded.size() == candidates);
  std::vector<std::uint8_t> open(candidates, 1);
  for (std::size_t i = 0; i < options.excluded.size(); ++i) {
    if (options.excluded[i] != 0) open[i] = 0;
  }
  const std::unique_ptr<LightChooser> chooser = make_chooser(basis, bins, options);
  for (const int taken : options.already) {
    CHECK(taken >= 0 && taken < bins.candidates());
    chooser->take(taken);
    open[static_cast<std::size_t>(taken)] = 0;
  }
  Selection selection;
  selection.mean_only_error_percent = percent_of_trace(basis, basis.stddev.squaredNorm());
  Standing before = standing_of_already(basis, *chooser, options);
  while (static_cast<int>(selection.lights.size()) < options.max_lights) {
    const Standing next = chooser->best(open);
    if (next.candidate < 0) break;
    if (!worth_taking(options, before, next)) {
      selection.plateau_reached = true;
      break;
    }
    const auto new_cells =
        static_cast<int>(unseen(bins.of(next.candidate), chooser->seen()).size());
    chooser->take(next.candidate);
    open[static_cast<std::size_t>(next.candidate)] = 0;
    selection.lights.push_back(reported(basis, *chooser, next, new_cells, options));
    before = next;
  }
  selection.statistics = chooser->statistics();
  return selection;
}

Conditioning conditioning(const BrdfBasis& basis, const CandidateBins& bins,
                          std::span<const int> candidates) {
  std::vector<std::uint8_t> seen(static_cast<std::size_t>(bins.grid.cells()), 0);
  for (const int candidate : candidates) {
    for (const std::int32_t cell : bins.of(candidate)) seen[static_cast<std::size_t>(cell)] = 1;
  }
  const Eigen::MatrixXd G = CellRows(basis).gather(marked(seen));
  return conditioning_of(singular_values(G), G.rows(), G.cols());
}

}  // namespace lightrig
