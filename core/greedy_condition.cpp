#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/candidate_groups.h"
#include "core/extreme_pair.h"
#include "core/group_extremes.h"
#include "core/parallel.h"
#include "core/planner_chooser.h"
#include "core/planner_kernels.h"

namespace lightrig {

namespace {

/// Iterations of a first look at a candidate, which most do not survive, and of a thorough one.
constexpr int glancing = 3, converging = 30;

/// κ² up to which the eigenvalues of RᵀR tell it to about 1e-12: their error is a few ε·κ².
constexpr double plain_condition = 1e4;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The condition criterion, exactly and with little work. With A = RᵀR of the lights taken and B of
/// the rows that a candidate adds, for any unit vectors x and y
///
///     λmin(A + B) ≤ |Rx|² + Σ (g·x)²,    λmax(A + B) ≥ |Ry|² + Σ (g·y)²,
///
/// so every pair (x, y) bounds κ² of every candidate from below, at one number per cell. A group of
/// candidates shares a pair: the extreme vectors of all that the group would add; where candidates
/// lack few of its cells, only these are looked at. The candidate of least bound is refined (its
/// own extreme vectors become the group's pair) and, when its refined bound is still the least,
/// decided by the singular values of [R; rows]. The refined bounds are sums of squares without
/// cancellation: they hold for matrices of any condition.
class ConditionChooser final : public LightChooser {
 public:
  ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                   const SelectionOptions& options);

  Standing best(const std::vector<std::uint8_t>& open) override;
  void take(std::span<const int> candidates) override;
  Standing standing() const override;
  Eigen::MatrixXd information() const override;
  void restart() override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  /// Bounded by its group's pair; by its own after a few iterations; by its own, converged.
  enum class Stage : std::uint8_t { bounded, refined, converged, decided };

  /// What candidates of one group share; the energies are of the cells of the group.
  struct Group {
    ExtremePair pair;
    double low = 0, high = 0;  ///< |Rx|² and |Ry|²
    std::vector<double> of_x, of_y;
    int next = -1;            ///< candidate of least bound that is not decided
    double bound = infinity;  ///< lower bound of κ² of those not decided
  };
  /// What is known of a candidate that was decided, kept until one is taken.
  struct Decision {
    int candidate = -1, rank = 0;
    PackedRows R;
  };

  void open_groups(const CandidateGroups::Distinct& distinct);
  void open_group(int group, std::span<const int> members);
  void bound_by_edge(int group, std::span<const int> members);
  void refine(int group, int candidate, int iterations);
  void refine_group(int group);
  void gather_information(int group, int candidate);
  void measure(int group);
  void bound_members(int group, std::span<const int> members);
  bool beyond_full_rank(const Group& group, std::span<const int> members) const;
  Conditioning conditioning_of_factor(const PackedRows& R, Eigen::Index cells) const;
  Standing decide(int candidate);
  void decide_deficient(const std::vector<int>& active, std::vector<Standing>& standings);
  void factor_with(std::span<const std::int32_t> cells, PackedRows& out,
                   std::vector<double>& scratch) const;
  PackedRows factor_with(std::span<const std::int32_t> cells) const;
  Stage& stage_of(int candidate) { return stage_[static_cast<std::size_t>(candidate)]; }
  Group& group_at(int g) { return group_[static_cast<std::size_t>(g)]; }

  Eigen::VectorXd scale_;  ///< s/σ
  CandidateGroups groups_;
  int k_, stride_, level_, threads_;
  GroupExtremes extremes_;
  PackedRows R_;              ///< QR factor of the rows taken, one row per "cell"
  std::vector<double> gram_;  ///< RᵀR, upper triangle, for vectors and bounds of groups
  std::vector<Group> group_;
  PairWork work_;
  std::vector<std::int32_t> cells_;  ///< of what is looked at
  std::vector<std::uint8_t> own_;    ///< (packed cells) all zero between calls
  PackedRows factor_;
  std::vector<double> scratch_;
  std::vector<double> low_;    ///< (candidates) upper bound of λmin
  std::vector<double> high_;   ///< (candidates) lower bound of λmax
  std::vector<double> bound_;  ///< (candidates) lower bound of κ²
  std::vector<Stage> stage_;
  std::vector<Decision> decisions_;
  int rank_ = 0;  ///< of the rows taken, −1: not known
  SelectionStatistics statistics_;
};

/// Lower bound of κ² of k components, with room for the rounding of its sums.
double bound_of(double low, double high, int k) {
  const double rounding = k * std::numeric_limits<double>::epsilon();
  const double least = std::sqrt(low) + rounding * std::sqrt(high);
  return (1 - 1e-11) * high / (least * least);
}

ConditionChooser::ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                                   const SelectionOptions& options)
    : scale_(basis.stddev / options.sigma),
      groups_(basis, bins, {}, std::max(1, options.threads)),
      k_(groups_.rows().k),
      stride_(groups_.rows().stride),
      level_(vector_level()),
      threads_(std::max(1, options.threads)),
      extremes_(groups_, threads_, level_),
      work_(k_, stride_) {
  R_.k = k_;
  R_.stride = stride_;
  gram_.assign(work_.A.size(), 0.0);
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

/// R of [R; rows of these cells], (min(rows, k) × stride), into `out`.
void ConditionChooser::factor_with(std::span<const std::int32_t> cells, PackedRows& out,
                                   std::vector<double>& scratch) const {
  const PackedRows& rows = groups_.rows();
  out.k = k_;
  out.stride = stride_;
  out.data.assign(R_.data.begin(), R_.data.end());
  for (const std::int32_t cell : cells) {
    const double* of_cell = rows.of(cell);
    out.data.insert(out.data.end(), of_cell,
                    of_cell + static_cast<std::ptrdiff_t>(rows.per_cell) * stride_);
  }
  const auto count = static_cast<int>(out.data.size() / static_cast<std::size_t>(stride_));
  if (count <= k_) return;
  scratch.resize(static_cast<std::size_t>(count + stride_));
  triangularize(out.data, count, k_, stride_, scratch, level_);
  out.data.resize(gram_.size());
  for (int i = 1; i < k_; ++i) {
    double* row = out.data.data() + static_cast<std::ptrdiff_t>(i) * stride_;
    std::fill(row, row + i, 0.0);
  }
}

PackedRows ConditionChooser::factor_with(std::span<const std::int32_t> cells) const {
  PackedRows R;
  std::vector<double> scratch;
  factor_with(cells, R, scratch);
  return R;
}

Standing ConditionChooser::decide(int candidate) {
  ++statistics_.exact_evaluations;
  const std::span<const std::int32_t> cells = groups_.fresh(candidate);
  PackedRows R = factor_with(cells);
  const Conditioning found =
      conditioning_of_factor(R, groups_.seen_cells() + static_cast<Eigen::Index>(cells.size()));
  decisions_.push_back({candidate, found.rank, std::move(R)});
  return {candidate, found.rank, found.pseudo_condition};
}

void ConditionChooser::take(std::span<const int> candidates) {
  const auto known = std::find_if(decisions_.begin(), decisions_.end(), [&](const Decision& d) {
    return candidates.size() == 1 && d.candidate == candidates.front();
  });
  const std::span<const std::int32_t> added = groups_.take(candidates);
  if (known != decisions_.end()) {
    R_ = std::move(known->R);
    rank_ = known->rank;
  } else if (!added.empty()) {  // lights captured already: nobody chose them here
    R_ = factor_with(added);
    rank_ = -1;
  }
  decisions_.clear();
  R_.per_cell = static_cast<int>(R_.data.size() / static_cast<std::size_t>(stride_));
  add_gram(groups_.rows(), added, gram_, level_);
  extremes_.take(added);
}

void ConditionChooser::restart() {
  groups_.restart();
  extremes_.restart();
  R_.data.clear();
  rank_ = 0;
  decisions_.clear();
  std::fill(gram_.begin(), gram_.end(), 0.0);
  statistics_ = {};
}

/// By the eigenvalues of RᵀR while they tell to about 1e-12, else by the singular values of R.
Conditioning ConditionChooser::conditioning_of_factor(const PackedRows& R,
                                                      Eigen::Index cells) const {
  const Eigen::Index rows = static_cast<Eigen::Index>(R.data.size()) / stride_;
  const Eigen::Map<const Eigen::MatrixXd> transposed(R.data.data(), stride_, rows);
  const Eigen::MatrixXd square = transposed.topRows(k_).transpose();
  if (rows == k_) {
    const Eigen::MatrixXd gram = square.transpose() * square;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(gram, Eigen::EigenvaluesOnly);
    const double least = eigen.eigenvalues()[0], greatest = eigen.eigenvalues()[k_ - 1];
    if (eigen.info() == Eigen::Success && least * plain_condition >= greatest) {
      return {greatest / least, greatest / least, k_};
    }
  }
  return conditioning_of(singular_values(square), cells * groups_.rows().per_cell, k_);
}

Eigen::MatrixXd ConditionChooser::information() const {
  const Eigen::Map<const Eigen::MatrixXd> gram(gram_.data(), stride_, k_);
  Eigen::MatrixXd A = scale_.asDiagonal() * gram.topRows(k_) * scale_.asDiagonal();
  A.diagonal().array() += 1;
  return A;
}

Standing ConditionChooser::standing() const {
  if (groups_.seen_cells() == 0) return {};
  const Conditioning found = conditioning_of_factor(R_, groups_.seen_cells());
  return {-1, found.rank, found.pseudo_condition};
}

/// |Rx|² and |Ry|², and the energies of the group's cells.
void ConditionChooser::measure(int g) {
  Group& group = group_at(g);
  group.low = group.high = 0;
  if (!R_.data.empty()) {
    const std::int32_t all = 0;
    cell_energies(R_, {&all, 1}, group.pair.x, group.pair.y, {&group.low, 1}, {&group.high, 1},
                  level_);
  }
  cell_energies(groups_.rows(), groups_.cells_of_group(g), group.pair.x, group.pair.y, group.of_x,
                group.of_y, level_);
}

/// work_.A = A + B of a candidate: its own rows, or its group's less what it lacks, where these are
/// fewer. Good enough for a refinement: whatever vectors come of it, bounds take them through sums
/// of squares.
void ConditionChooser::gather_information(int g, int candidate) {
  const std::span<const std::int32_t> own = groups_.fresh(candidate);
  std::copy(gram_.begin(), gram_.end(), work_.A.begin());
  for (const std::int32_t cell : own) own_[static_cast<std::size_t>(cell)] = 1;
  cells_.clear();
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (!groups_.packed_seen(cell) && own_[static_cast<std::size_t>(cell)] == 0) {
      cells_.push_back(cell);
    }
  }
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
    factor_with(groups_.fresh(candidate), factor_, scratch_);
    if (factor_.data.size() >= gram_.size()) {
      refine_least_by_factor(pair.x, factor_.data, k_, stride_, work_, level_);
    }
  }
  measure(g);
}

/// The same with all that the group would add, by the factor of its rows.
void ConditionChooser::refine_group(int g) {
  ExtremePair& pair = group_at(g).pair;
  cells_.clear();
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (!groups_.packed_seen(cell)) cells_.push_back(cell);
  }
  std::copy(gram_.begin(), gram_.end(), work_.A.begin());
  add_gram(groups_.rows(), cells_, work_.A, level_);
  refine_greatest(pair.y, k_, stride_, converging, work_, level_);
  factor_with(cells_, factor_, scratch_);
  if (factor_.data.size() < gram_.size()) return;
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
    bound_[i] = bound_of(low_[i], high_[i], k_);
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
    bound_[i] = bound_of(low_[i], high_[i], k_);
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
  extremes_.look(gram_);
  parallel_ranges(groups_.groups(), 4, threads_, [&](std::int64_t first, std::int64_t last, int) {
    for (int g = static_cast<int>(first); g < static_cast<int>(last); ++g) {
      open_group(g, distinct.of_group(g));
    }
  });
  for (int g = 0; g < groups_.groups(); ++g) {
    const std::span<const int> members = distinct.of_group(g);
    if (members.empty() || extremes_.of(g).known) continue;
    refine_group(g);
    measure(g);
    bound_members(g, members);
  }
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
  const double rows = static_cast<double>(std::max<Eigen::Index>(
      k_, (groups_.seen_cells() + static_cast<Eigen::Index>(most)) * groups_.rows().per_cell));
  const double ratio = rows * std::numeric_limits<double>::epsilon();
  return group.bound > 0.25 / (ratio * ratio);
}

Standing ConditionChooser::best(const std::vector<std::uint8_t>& open) {
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
      refine(g, next, stage == Stage::bounded ? glancing : converging);
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

}  // namespace

std::unique_ptr<LightChooser> make_condition_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& options) {
  return std::make_unique<ConditionChooser>(basis, bins, options);
}

}  // namespace lightrig
