#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/candidate_groups.h"
#include "core/parallel.h"
#include "core/planner_chooser.h"
#include "core/planner_kernels.h"
#include "core/symmetric_kernels.h"

namespace lightrig {

namespace {

/// Iterations of a first look at a candidate, which most do not survive, and of a thorough one.
constexpr int glancing = 3, converging = 30;

/// Candidates from which on a step's first bounds are worth a second thread.
constexpr std::size_t many_candidates = 8192;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Makes x a unit vector and returns how long it was; 0 where it has no direction. Rows of any size
/// are welcome: their squares may leave the range.
double normalize(std::span<double> x) {
  double most = 0, sum = 0;
  for (const double v : x) most = std::max(most, std::abs(v));
  if (!(most > 0) || !std::isfinite(most) || !std::isfinite(1 / most)) return 0;
  for (double& v : x) {
    v *= 1 / most;
    sum += v * v;
  }
  const double length = std::sqrt(sum);
  for (double& v : x) v /= length;
  return most * length;
}

double dot(std::span<const double> a, std::span<const double> b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

/// The condition criterion, exactly and with little work. With A = RᵀR of the lights taken and B of
/// the rows that a candidate adds, for any unit vectors x and y
///
///     λmin(A + B) ≤ |Rx|² + Σ (g·x)²,    λmax(A + B) ≥ |Ry|² + Σ (g·y)²,
///
/// so every pair (x, y) bounds κ² of every candidate from below, at one number per cell. A group of
/// candidates shares a pair: the extreme vectors of all that the group would add, by inverse and
/// plain iteration. The candidate of least bound is refined (its own extreme vectors become the
/// group's pair) and, when its refined bound is still the least, decided by the singular values of
/// [R; rows]. Sums of squares have no cancellation: the bounds hold for matrices of any condition.
class ConditionChooser final : public LightChooser {
 public:
  ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                   const SelectionOptions& options);

  Standing best(const std::vector<std::uint8_t>& open) override;
  void take(std::span<const int> candidates) override;
  Standing standing() const override;
  void restart() override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  /// Bounded by its group's pair; by its own after a few iterations; by its own, converged.
  enum class Stage : std::uint8_t { bounded, refined, converged, decided };

  /// A pair of unit vectors with |Rx|² and |Ry|², and the energies of cells along them.
  struct Pair {
    std::vector<double> x, y;  ///< (stride), zeros at the end; empty until first looked at
    double low = 0, high = 0;
    std::vector<double> of_x, of_y;
  };
  /// What candidates of one group share; its energies are of the cells of the group.
  struct Group : Pair {
    std::vector<double> gram;  ///< of the group's unseen cells, for refinement only
    std::size_t in_gram = 0;   ///< how many these were
    bool looked_at = false;    ///< since a light was last taken
    int next = -1;             ///< candidate of least bound that is not decided
  };
  /// Memory that one worker uses again for every group.
  struct Work {
    std::vector<double> A, R, z, scratch;
    PackedRows factor;
    std::vector<std::uint8_t> own;  ///< (packed cells) all zero between calls
    std::vector<std::int32_t> cells;
  };
  /// What is known of a candidate that was decided, kept until one is taken.
  struct Decision {
    int candidate = -1, rank = 0;
    PackedRows R;
  };

  void refine(int group, int candidate, int iterations, Work& work);
  void gather_information(int group, int candidate, Work& work);
  bool refine_least(Pair& pair, double top, int iterations, Work& work) const;
  void refine_by_qr(Group& group, std::span<const std::int32_t> cells, Work& work) const;
  void measure_taken(Pair& pair) const;
  void measure_cells(int group);
  void bound_members(int group, std::span<const int> members);
  double bound(int candidate) const;
  void first_look(const CandidateGroups::Distinct& distinct);
  bool look_at_weakest();
  bool beyond_full_rank(int candidate) const;
  Conditioning conditioning_of_factor(const PackedRows& R, Eigen::Index cells) const;
  Standing decide(int candidate);
  void decide_deficient(const std::vector<int>& active, std::vector<Standing>& standings);
  void factor_with(std::span<const std::int32_t> cells, PackedRows& out,
                   std::vector<double>& scratch) const;
  PackedRows factor_with(std::span<const std::int32_t> cells) const;
  Stage& stage_of(int candidate) { return stage_[static_cast<std::size_t>(candidate)]; }

  CandidateGroups groups_;
  int k_, stride_, level_, threads_;
  PackedRows R_;              ///< QR factor of the rows taken, one row per "cell"
  std::vector<double> gram_;  ///< RᵀR, upper triangle, for refinement only
  std::vector<Group> group_;
  Pair weakest_;  ///< where the rows taken are weakest; energies of all packed cells
  std::vector<std::int32_t> all_cells_;
  std::vector<Work> work_;
  std::vector<double> low_;    ///< (candidates) upper bound of λmin
  std::vector<double> high_;   ///< (candidates) lower bound of λmax
  std::vector<double> bound_;  ///< (candidates) lower bound of κ²
  std::vector<Stage> stage_;
  std::vector<Decision> decisions_;
  int rank_ = 0;  ///< of the rows taken, −1: not known
  SelectionStatistics statistics_;
};

ConditionChooser::ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                                   const SelectionOptions& options)
    : groups_(basis, bins, {}),
      k_(groups_.rows().k),
      stride_(groups_.rows().stride),
      level_(vector_level()),
      threads_(std::max(1, options.threads)) {
  R_.k = k_;
  R_.stride = stride_;
  const auto size = static_cast<std::size_t>(k_) * static_cast<std::size_t>(stride_);
  gram_.assign(size, 0.0);
  const auto n = static_cast<std::size_t>(groups_.candidates());
  low_.assign(n, 0.0);
  high_.assign(n, 0.0);
  bound_.assign(n, 0.0);
  stage_.assign(n, Stage::bounded);
  group_.resize(static_cast<std::size_t>(groups_.groups()));
  for (std::size_t g = 0; g < group_.size(); ++g) {
    const std::size_t cells = groups_.cells_of_group(static_cast<int>(g)).size();
    group_[g].of_x.resize(cells);
    group_[g].of_y.resize(cells);
    group_[g].gram.resize(size);
  }
  const PackedRows& rows = groups_.rows();
  work_.resize(static_cast<std::size_t>(threads_));
  for (Work& work : work_) {
    work.A.resize(size);
    work.R.resize(size);
    work.z.resize(static_cast<std::size_t>(stride_));
    work.own.assign(rows.data.size() / static_cast<std::size_t>(stride_ * rows.per_cell), 0);
    work.cells.reserve(work.own.size());
  }
  all_cells_.resize(work_.front().own.size());
  std::iota(all_cells_.begin(), all_cells_.end(), 0);
  weakest_.of_x.resize(all_cells_.size());
  weakest_.of_y.resize(all_cells_.size());
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
  for (Group& group : group_) {
    if (!group.x.empty()) measure_taken(group);
  }
}

void ConditionChooser::restart() {
  groups_.restart();
  R_.data.clear();
  rank_ = 0;
  decisions_.clear();
  std::fill(gram_.begin(), gram_.end(), 0.0);
  statistics_ = {};
  for (Group& group : group_) {
    group.in_gram = 0;
    measure_taken(group);
  }
}

Conditioning ConditionChooser::conditioning_of_factor(const PackedRows& R,
                                                      Eigen::Index cells) const {
  const Eigen::Index rows = static_cast<Eigen::Index>(R.data.size()) / stride_;
  const Eigen::Map<const Eigen::MatrixXd> transposed(R.data.data(), stride_, rows);
  const Eigen::MatrixXd square = transposed.topRows(k_).transpose();
  return conditioning_of(singular_values(square), cells * groups_.rows().per_cell, k_);
}

Standing ConditionChooser::standing() const {
  if (groups_.seen_cells() == 0) return {};
  const Conditioning found = conditioning_of_factor(R_, groups_.seen_cells());
  return {-1, found.rank, found.pseudo_condition};
}

/// |Rx|² and |Ry|².
void ConditionChooser::measure_taken(Pair& pair) const {
  pair.low = pair.high = 0;
  if (R_.data.empty()) return;
  const std::int32_t all = 0;
  cell_energies(R_, {&all, 1}, pair.x, pair.y, {&pair.low, 1}, {&pair.high, 1}, level_);
}

void ConditionChooser::measure_cells(int g) {
  Group& group = group_[static_cast<std::size_t>(g)];
  cell_energies(groups_.rows(), groups_.cells_of_group(g), group.x, group.y, group.of_x, group.of_y,
                level_);
}

/// work.A = A + B of a candidate, or of all that its group would add where candidate < 0. A group's
/// rows are summed once and again only when some of them were taken; a candidate's B is that less
/// what it lacks, where this is the fewer. Good enough for a refinement: whatever vectors come of
/// it, bounds take them through sums of squares.
void ConditionChooser::gather_information(int g, int candidate, Work& work) {
  Group& group = group_[static_cast<std::size_t>(g)];
  const PackedRows& rows = groups_.rows();
  const std::span<const std::int32_t> own =
      candidate >= 0 ? groups_.fresh(candidate) : std::span<const std::int32_t>();
  work.cells.clear();
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (!groups_.packed_seen(cell)) work.cells.push_back(cell);
  }
  std::copy(gram_.begin(), gram_.end(), work.A.begin());
  if (candidate >= 0 && 2 * (work.cells.size() - own.size()) >= own.size()) {
    add_gram(rows, own, work.A, level_);
    return;
  }
  if (group.in_gram != work.cells.size()) {  // cells only ever leave: as many are the same
    group.in_gram = work.cells.size();
    std::fill(group.gram.begin(), group.gram.end(), 0.0);
    add_gram(rows, work.cells, group.gram, level_);
  }
  for (std::size_t i = 0; i < work.A.size(); ++i) work.A[i] += group.gram[i];
  if (candidate < 0) return;
  for (const std::int32_t cell : own) work.own[static_cast<std::size_t>(cell)] = 1;
  std::erase_if(work.cells,
                [&](std::int32_t cell) { return work.own[static_cast<std::size_t>(cell)] != 0; });
  for (const std::int32_t cell : own) work.own[static_cast<std::size_t>(cell)] = 0;
  add_gram(rows, work.cells, work.A, level_, -1);
}

/// The extreme vectors of A + B by QR and triangular solves: for what Cholesky cannot factor.
void ConditionChooser::refine_by_qr(Group& group, std::span<const std::int32_t> cells,
                                    Work& work) const {
  factor_with(cells, work.factor, work.scratch);
  if (work.factor.data.size() < gram_.size()) return;
  std::copy(group.x.begin(), group.x.end(), work.z.begin());
  for (int i = 0; i < 8; ++i) {
    solve_with_factor(work.factor.data, k_, stride_, work.z, level_);
    if (normalize(work.z) == 0) return;
    std::copy(work.z.begin(), work.z.end(), group.x.begin());
  }
}

/// x towards the least eigenvector of work.A by inverse iteration; false where Cholesky is not fit
/// for it. `top` is about the greatest eigenvalue.
bool ConditionChooser::refine_least(Pair& pair, double top, int iterations, Work& work) const {
  std::copy(work.A.begin(), work.A.end(), work.R.begin());
  if (!cholesky(work.R, k_, stride_, level_)) return false;
  double last = infinity;
  for (int i = 0; i < iterations; ++i) {
    std::copy(pair.x.begin(), pair.x.end(), work.z.begin());
    solve_with_factor(work.R, k_, stride_, work.z, level_);
    const double length = normalize(work.z);
    if (length == 0) return false;
    const double quotient = dot(work.z, pair.x) / length;
    if (!(quotient > 1e-10 * top)) return false;
    pair.x.swap(work.z);
    if (last - quotient <= 1e-7 * quotient) break;
    last = quotient;
  }
  return true;
}

/// The group's pair towards the extreme vectors of A + B, of a candidate or of all that the group
/// would add, as far as a few iterations from the pair so far take them.
void ConditionChooser::refine(int g, int candidate, int iterations, Work& work) {
  Group& group = group_[static_cast<std::size_t>(g)];
  gather_information(g, candidate, work);
  if (group.x.empty()) {
    // Any start with a part in every direction will do.
    group.x.assign(static_cast<std::size_t>(stride_), 0.0);
    for (int i = 0; i < k_; ++i) {
      group.x[static_cast<std::size_t>(i)] = 1 + 0.5 * std::sin(1.0 + 3.0 * i);
    }
    normalize(group.x);
    group.y = group.x;
  }
  double top = 0;
  for (int i = 0; i < iterations; ++i) {
    multiply(work.A, k_, stride_, group.y, work.z, level_);
    const double length = normalize(work.z);
    if (length == 0) break;
    group.y.swap(work.z);
    const bool settled = length - top <= 1e-3 * length;
    top = length;
    if (settled && i >= 1) break;
  }
  if (!refine_least(group, top, iterations, work)) {
    if (candidate < 0) {
      work.cells.clear();
      for (const std::int32_t cell : groups_.cells_of_group(g)) {
        if (!groups_.packed_seen(cell)) work.cells.push_back(cell);
      }
    }
    refine_by_qr(group, candidate < 0 ? work.cells : groups_.fresh(candidate), work);
  }
  measure_taken(group);
  measure_cells(g);
}

/// Tightens the bounds of a group's candidates by its pair.
void ConditionChooser::bound_members(int g, std::span<const int> members) {
  Group& group = group_[static_cast<std::size_t>(g)];
  group.next = -1;
  double least = infinity;
  for (const int candidate : members) {
    const auto i = static_cast<std::size_t>(candidate);
    double low = group.low, high = group.high;
    for (const std::int32_t place : groups_.places(candidate)) {
      low += group.of_x[static_cast<std::size_t>(place)];
      high += group.of_y[static_cast<std::size_t>(place)];
    }
    low_[i] = std::min(low_[i], low);
    high_[i] = std::max(high_[i], high);
    bound_[i] = bound(candidate);
    if (stage_[i] == Stage::decided) continue;
    if (group.next < 0 || bound_[i] < least) {
      group.next = candidate;
      least = bound_[i];
    }
  }
}

/// Lower bound of κ², with room for the rounding of its sums.
double ConditionChooser::bound(int candidate) const {
  const auto i = static_cast<std::size_t>(candidate);
  const double rounding = k_ * std::numeric_limits<double>::epsilon();
  const double least = std::sqrt(low_[i]) + rounding * std::sqrt(high_[i]);
  return (1 - 1e-11) * high_[i] / (least * least);
}

/// The extreme vectors of the rows taken alone: most candidates do little for the weakest.
bool ConditionChooser::look_at_weakest() {
  if (R_.data.size() < gram_.size()) return false;
  if (weakest_.x.empty()) {
    const auto looked_at = std::find_if(group_.begin(), group_.end(),
                                        [](const Group& group) { return !group.x.empty(); });
    if (looked_at == group_.end()) return false;
    weakest_.x = looked_at->x;
    weakest_.y = looked_at->y;
  }
  Work& work = work_.front();
  std::copy(gram_.begin(), gram_.end(), work.A.begin());
  if (!refine_least(weakest_, 0, converging, work)) return false;
  measure_taken(weakest_);
  cell_energies(groups_.rows(), all_cells_, weakest_.x, weakest_.y, weakest_.of_x, weakest_.of_y,
                level_);
  return true;
}

/// Every candidate's bound by its group's pair as it stands, or a neighbour's where there is none,
/// and by where the rows taken are weakest.
void ConditionChooser::first_look(const CandidateGroups::Distinct& distinct) {
  const bool weakest = look_at_weakest();
  const Group* neighbour = nullptr;
  for (int g = 0; g < groups_.groups(); ++g) {
    Group& group = group_[static_cast<std::size_t>(g)];
    group.looked_at = false;
    group.next = -1;
    if (group.x.empty() && !distinct.of_group(g).empty()) {
      if (neighbour != nullptr) {
        group.x = neighbour->x;
        group.y = neighbour->y;
        measure_taken(group);
        measure_cells(g);
      } else {
        refine(g, -1, converging, work_.front());
        group.looked_at = true;
      }
    }
    if (!group.x.empty()) neighbour = &group;
  }
  const int threads = distinct.candidates.size() >= many_candidates ? threads_ : 1;
  parallel_ranges(groups_.groups(), 1, threads, [&](std::int64_t first, std::int64_t last, int) {
    for (int g = static_cast<int>(first); g < static_cast<int>(last); ++g) {
      for (const int candidate : distinct.of_group(g)) {
        const auto i = static_cast<std::size_t>(candidate);
        stage_[i] = Stage::bounded;
        low_[i] = weakest ? weakest_.low : infinity;
        high_[i] = weakest ? weakest_.high : 0;
        if (!weakest) continue;
        for (const std::int32_t cell : groups_.fresh(candidate)) {
          low_[i] += weakest_.of_x[static_cast<std::size_t>(cell)];
          high_[i] += weakest_.of_y[static_cast<std::size_t>(cell)];
        }
      }
      bound_members(g, distinct.of_group(g));
    }
  });
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

/// Whether a candidate's bound is beyond what counts as full rank.
bool ConditionChooser::beyond_full_rank(int candidate) const {
  const double rows = static_cast<double>(std::max<Eigen::Index>(
      k_, (groups_.seen_cells() + static_cast<Eigen::Index>(groups_.fresh(candidate).size())) *
              groups_.rows().per_cell));
  const double ratio = rows * std::numeric_limits<double>::epsilon();
  return bound_[static_cast<std::size_t>(candidate)] > 0.25 / (ratio * ratio);
}

Standing ConditionChooser::best(const std::vector<std::uint8_t>& open) {
  const CandidateGroups::Distinct& distinct = groups_.distinct(open);
  statistics_.identical_candidates += distinct.identical;
  statistics_.empty_candidates += distinct.empty;
  first_look(distinct);
  decisions_.clear();
  std::vector<Standing> standings;
  Standing leader;  // best of full rank
  while (true) {
    int next = -1;
    for (const Group& group : group_) {
      if (group.next < 0) continue;
      if (next < 0 ||
          bound_[static_cast<std::size_t>(group.next)] < bound_[static_cast<std::size_t>(next)]) {
        next = group.next;
      }
    }
    if (next < 0) break;
    if (leader.candidate >= 0) {
      if (bound_[static_cast<std::size_t>(next)] >
          leader.score * (1 + 2 * tie_tolerance(leader.score))) {
        break;
      }
    } else if (beyond_full_rank(next)) {
      decide_deficient(distinct.candidates, standings);
      break;
    }
    const int g = groups_.group_of(next);
    Group& group = group_[static_cast<std::size_t>(g)];
    Stage& stage = stage_of(next);
    if (!group.looked_at) {
      group.looked_at = true;
      refine(g, -1, glancing, work_.front());
    } else if (stage == Stage::bounded || stage == Stage::refined) {
      refine(g, next, stage == Stage::bounded ? glancing : converging, work_.front());
      stage = stage == Stage::bounded ? Stage::refined : Stage::converged;
    } else {
      stage = Stage::decided;
      standings.push_back(decide(next));
      const Standing& found = standings.back();
      if (found.rank == k_ && (leader.candidate < 0 || found.score < leader.score)) leader = found;
    }
    bound_members(g, distinct.of_group(g));
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
