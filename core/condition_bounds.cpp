// Bounds of the condition criterion: what shows that a candidate need not be decided.

#include <algorithm>
#include <limits>

#include "core/condition_chooser.h"
#include "core/row_factor.h"

namespace lightrig {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

/// |Rx|² and |Ry|², and the energies of the group's cells.
void ConditionChooser::measure(int g) {
  Group& group = group_at(g);
  const TakenRows::Energies taken = taken_.energies(group.pair.x, group.pair.y);
  group.low = taken.of_x;
  group.high = taken.of_y;
  cell_energies(groups_.rows(), groups_.cells_of_group(g), group.pair.x, group.pair.y, group.of_x,
                group.of_y, level_);
}

/// The unseen cells of a group, in cells_.
void ConditionChooser::list_unseen(int g) {
  cells_.clear();
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (!groups_.packed_seen(cell)) cells_.push_back(cell);
  }
}

/// work_.A = A + B of a candidate: its own rows, or its group's less what it lacks, where these are
/// fewer. Good enough for a refinement: whatever vectors come of it, bounds take them through sums
/// of squares.
void ConditionChooser::gather_information(int g, int candidate) {
  const std::span<const std::int32_t> own = groups_.fresh(candidate);
  std::copy(taken_.gram().begin(), taken_.gram().end(), work_.A.begin());
  for (const std::int32_t cell : own) own_[static_cast<std::size_t>(cell)] = 1;
  list_unseen(g);
  std::erase_if(cells_,
                [&](std::int32_t cell) { return own_[static_cast<std::size_t>(cell)] != 0; });
  for (const std::int32_t cell : own) own_[static_cast<std::size_t>(cell)] = 0;
  if (2 * cells_.size() >= own.size()) {
    add_gram(groups_.rows(), own, work_.A, level_);
    return;
  }
  extremes_.add_group(g, work_.A);
  add_gram(groups_.rows(), cells_, work_.A, level_, -1);
}

/// The group's pair towards the extreme vectors of A + B of a candidate, as far as a few iterations
/// from the pair so far take them.
void ConditionChooser::refine(int g, int candidate, int iterations) {
  ExtremePair& pair = group_at(g).pair;
  gather_information(g, candidate);
  const double top = refine_greatest(pair.y, k_, stride_, iterations, work_, level_);
  if (!refine_least(pair.x, top, k_, stride_, iterations, work_, level_)) {
    extend_factor(taken_.factor(), groups_.rows(), groups_.fresh(candidate), factor_, scratch_,
                  level_);
    if (factor_.data.size() >= work_.A.size()) {
      refine_least_by_factor(pair.x, factor_.data, k_, stride_, work_, level_);
    }
  }
  measure(g);
}

/// The same with all that the group would add, by the factor of its rows.
void ConditionChooser::refine_group(int g) {
  ExtremePair& pair = group_at(g).pair;
  list_unseen(g);
  std::copy(taken_.gram().begin(), taken_.gram().end(), work_.A.begin());
  add_gram(groups_.rows(), cells_, work_.A, level_);
  refine_greatest(pair.y, k_, stride_, thorough_iterations, work_, level_);
  extend_factor(taken_.factor(), groups_.rows(), cells_, factor_, scratch_, level_);
  if (factor_.data.size() < work_.A.size()) return;
  refine_least_by_factor(pair.x, factor_.data, k_, stride_, work_, level_);
}

/// Tightens the bounds of a group's candidates by its pair.
void ConditionChooser::bound_members(int g, std::span<const int> members) {
  Group& group = group_at(g);
  group.next = -1;
  group.bound = infinity;
  for (const int candidate : members) {
    const auto i = static_cast<std::size_t>(candidate);
    double low = group.low, high = group.high;
    for (const std::int32_t place : groups_.places(candidate)) {
      low += group.of_x[static_cast<std::size_t>(place)];
      high += group.of_y[static_cast<std::size_t>(place)];
    }
    low_[i] = std::min(low_[i], low);
    high_[i] = std::max(high_[i], high);
    bound_[i] = condition_bound(low_[i], high_[i], k_);
    if (stage_[i] == Stage::decided) continue;
    if (group.next < 0 || bound_[i] < group.bound) {
      group.next = candidate;
      group.bound = bound_[i];
    }
  }
}

/// Bounds of a group's candidates by its extreme vectors and totals less what each lacks. The
/// totals are quadratic forms of summed matrices: their rounding is part of the bounds.
void ConditionChooser::bound_by_edge(int g, std::span<const int> members) {
  Group& group = group_at(g);
  const GroupExtremes::Extremes found = extremes_.of(g);
  const std::span<const std::int32_t> edge = groups_.edge(g);
  const std::span<double> of_x = std::span(group.of_x).first(edge.size());
  const std::span<double> of_y = std::span(group.of_y).first(edge.size());
  cell_energies(groups_.rows(), edge, group.pair.x, group.pair.y, of_x, of_y, level_);
  for (std::size_t e = 0; e < edge.size(); ++e) {
    if (groups_.packed_seen(edge[e])) of_x[e] = of_y[e] = 0;
  }
  group.bound = infinity;
  for (const int candidate : members) {
    const auto i = static_cast<std::size_t>(candidate);
    double low = found.low, high = found.high;
    for (const std::int32_t place : groups_.lacks(candidate)) {
      low -= of_x[static_cast<std::size_t>(place)];
      high -= of_y[static_cast<std::size_t>(place)];
    }
    low_[i] = std::max(0.0, low) + found.rounding;
    high_[i] = std::max(0.0, high - found.rounding);
    bound_[i] = condition_bound(low_[i], high_[i], k_);
    if (group.next >= 0 && !(bound_[i] < group.bound)) continue;
    group.next = candidate;
    group.bound = bound_[i];
  }
}

/// The first bounds of a group's candidates.
void ConditionChooser::open_group(int g, std::span<const int> members) {
  Group& group = group_at(g);
  group.next = -1;
  group.bound = infinity;
  if (members.empty()) return;
  for (const int candidate : members) {
    const auto i = static_cast<std::size_t>(candidate);
    stage_[i] = Stage::bounded;
    low_[i] = infinity;
    high_[i] = 0;
  }
  if (!extremes_.of(g).known) return;
  extremes_.copy_vectors(g, group.pair.x, group.pair.y);
  if (groups_.lacking(g)) {
    bound_by_edge(g, members);
  } else {
    measure(g);
    bound_members(g, members);
  }
}

void ConditionChooser::open_groups(const CandidateGroups::Distinct& distinct) {
  extremes_.look(taken_.gram(), [&](int g) { open_group(g, distinct.of_group(g)); });
  for (int g = 0; g < groups_.groups(); ++g) {
    const std::span<const int> members = distinct.of_group(g);
    if (members.empty() || extremes_.of(g).known) continue;
    refine_group(g);
    measure(g);
    bound_members(g, members);
  }
}

}  // namespace lightrig
