// Choosing by the condition criterion: the candidates that no bound leaves out are decided.

#include <algorithm>
#include <limits>

#include "core/condition_chooser.h"
#include "core/row_factor.h"

namespace lightrig {

ConditionChooser::ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                                   const SelectionOptions& options)
    : scale_(basis.stddev / options.sigma),
      groups_(basis, bins, {}, std::max(1, options.threads)),
      k_(groups_.rows().k),
      stride_(groups_.rows().stride),
      level_(vector_level()),
      threads_(std::max(1, options.threads)),
      extremes_(groups_, threads_, level_),
      taken_(groups_.rows(), level_),
      work_(k_, stride_) {
  const auto n = static_cast<std::size_t>(groups_.candidates());
  for (std::vector<double>* of_candidate : {&low_, &high_, &bound_}) {
    of_candidate->assign(n, 0.0);
  }
  stage_.assign(n, Stage::bounded);
  group_.resize(static_cast<std::size_t>(groups_.groups()));
  for (int g = 0; g < groups_.groups(); ++g) {
    Group& group = group_at(g);
    group.pair = any_pair(k_, stride_);
    group.of_x.resize(groups_.cells_of_group(g).size());
    group.of_y.resize(group.of_x.size());
  }
  own_.assign(groups_.seen_packed().size(), 0);
  cells_.reserve(own_.size());
}

Standing ConditionChooser::decide(int candidate) {
  ++statistics_.exact_evaluations;
  const std::span<const std::int32_t> cells = groups_.fresh(candidate);
  std::copy(taken_.gram().begin(), taken_.gram().end(), work_.A.begin());
  add_gram(groups_.rows(), cells, work_.A, level_);
  if (const auto plain = conditioning_of_gram(work_.A, k_, stride_)) {
    decisions_.push_back({candidate, *plain, {}});
  } else {
    PackedRows R;
    extend_factor(taken_.factor(), groups_.rows(), cells, R, scratch_, level_);
    const Conditioning found = conditioning_of_factor(R, rows_with(cells.size()));
    decisions_.push_back({candidate, found, std::move(R)});
  }
  const Conditioning& found = decisions_.back().found;
  return {candidate, found.rank, found.pseudo_condition};
}

void ConditionChooser::stand_on(const Eigen::MatrixXd& rows) {
  if (rows.rows() == 0) return;
  taken_.stand_on(rows);
  rank_ = -1;
}

void ConditionChooser::take(std::span<const int> candidates) {
  const auto known = std::find_if(decisions_.begin(), decisions_.end(), [&](const Decision& d) {
    return candidates.size() == 1 && d.candidate == candidates.front();
  });
  const std::span<const std::int32_t> added = groups_.take(candidates);
  if (known != decisions_.end()) {
    rank_ = known->found.rank;
    plain_ = known->R.data.empty();
    if (plain_) {
      taken_.take(added);
    } else {
      taken_.take(added, std::move(known->R));
    }
  } else if (!added.empty()) {  // lights captured already: nobody chose them here
    taken_.take(added);
    rank_ = -1;
    plain_ = false;
  }
  decisions_.clear();
  extremes_.take(added);
}

void ConditionChooser::restart() {
  groups_.restart();
  extremes_.restart();
  taken_.clear();
  rank_ = 0;
  plain_ = false;
  decisions_.clear();
  statistics_ = {};
}

Eigen::MatrixXd ConditionChooser::information() const {
  const Eigen::Map<const Eigen::MatrixXd> gram(taken_.gram().data(), stride_, k_);
  Eigen::MatrixXd A = scale_.asDiagonal() * gram.topRows(k_) * scale_.asDiagonal();
  A.diagonal().array() += 1;
  return A;
}

Standing ConditionChooser::standing() {
  if (taken_.count() == 0) return {};
  const auto plain = conditioning_of_gram(taken_.gram(), k_, stride_);
  plain_ = plain.has_value();
  const Conditioning found = plain ? *plain : conditioning_of_factor(taken_.factor(), rows_with(0));
  rank_ = found.rank;
  return {-1, found.rank, found.pseudo_condition};
}

/// No candidate reaches full rank: the rank decides, and its bound is the number of rows.
void ConditionChooser::decide_deficient(const std::vector<int>& active,
                                        std::vector<Standing>& standings) {
  if (rank_ < 0) rank_ = standing().rank;
  const auto rank_bound = [&](int i) {
    const std::size_t rows =
        groups_.fresh(i).size() * static_cast<std::size_t>(groups_.rows().per_cell);
    return std::min<std::int64_t>(k_, rank_ + static_cast<std::int64_t>(rows));
  };
  std::vector<int> open;
  for (const int i : active) {
    if (stage_of(i) != Stage::decided) open.push_back(i);
  }
  std::stable_sort(open.begin(), open.end(),
                   [&](int a, int b) { return rank_bound(a) > rank_bound(b); });
  int reached = 0;
  for (const Standing& s : standings) reached = std::max(reached, s.rank);
  for (const int i : open) {
    if (rank_bound(i) < reached) break;
    standings.push_back(decide(i));
    reached = std::max(reached, standings.back().rank);
  }
}

/// Whether a group's bound is beyond what counts as full rank.
bool ConditionChooser::beyond_full_rank(const Group& group, std::span<const int> members) const {
  std::size_t most = 0;
  for (const int candidate : members) most = std::max(most, groups_.fresh(candidate).size());
  const double rows = static_cast<double>(std::max<Eigen::Index>(k_, rows_with(most)));
  const double ratio = rows * std::numeric_limits<double>::epsilon();
  return group.bound > 0.25 / (ratio * ratio);
}

Standing ConditionChooser::best(const std::vector<std::uint8_t>& open) {
  if (!plain_) taken_.factor();  // bounds need sums of squares
  const CandidateGroups::Distinct& distinct = groups_.distinct(open);
  statistics_.identical_candidates += distinct.identical;
  statistics_.empty_candidates += distinct.empty;
  open_groups(distinct);
  decisions_.clear();
  std::vector<Standing> standings;
  Standing leader;  // best of full rank
  while (true) {
    int g = -1;
    for (int other = 0; other < groups_.groups(); ++other) {
      if (group_at(other).next < 0) continue;
      if (g < 0 || group_at(other).bound < group_at(g).bound) g = other;
    }
    if (g < 0) break;
    const Group& group = group_at(g);
    const std::span<const int> members = distinct.of_group(g);
    if (leader.candidate >= 0) {
      if (group.bound > leader.score * (1 + 2 * tie_tolerance(leader.score))) break;
    } else if (beyond_full_rank(group, members)) {
      decide_deficient(distinct.candidates, standings);
      break;
    }
    const int next = group.next;
    Stage& stage = stage_of(next);
    if (stage == Stage::bounded || stage == Stage::refined) {
      refine(g, next, stage == Stage::bounded ? glancing_iterations : thorough_iterations);
      stage = stage == Stage::bounded ? Stage::refined : Stage::converged;
    } else {
      stage = Stage::decided;
      standings.push_back(decide(next));
      const Standing& found = standings.back();
      if (found.rank == k_ && (leader.candidate < 0 || found.score < leader.score)) leader = found;
    }
    bound_members(g, members);
  }
  statistics_.bounded_away +=
      static_cast<std::int64_t>(distinct.candidates.size() - standings.size());
  return best_of(standings);
}

std::unique_ptr<LightChooser> make_condition_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& options) {
  return std::make_unique<ConditionChooser>(basis, bins, options);
}

}  // namespace lightrig
