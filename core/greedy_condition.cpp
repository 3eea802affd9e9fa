#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "core/candidate_groups.h"
#include "core/planner_chooser.h"
#include "core/planner_kernels.h"

namespace lightrig {

namespace {

using Lower = Eigen::Map<const Eigen::MatrixXd, Eigen::Unaligned, Eigen::OuterStride<>>;

/// Iterations of a first look at a candidate, which most do not survive, and of a thorough one.
constexpr int glancing = 3, converging = 30;

/// The condition criterion, exactly and with little work. With A = RᵀR of the lights taken and B of
/// the rows that a candidate adds, for any unit vectors x and y
///
///     λmin(A + B) ≤ |Rx|² + Σ (g·x)²,    λmax(A + B) ≥ |Ry|² + Σ (g·y)²,
///
/// so every pair (x, y) bounds κ² of every candidate from below, at one number per cell. A group of
/// candidates shares a pair; the candidate of least bound is refined (its own extreme vectors, by
/// inverse and plain iteration, become the group's pair) and, when its refined bound is still the
/// least, decided by the singular values of [R; rows]. Sums of squares have no cancellation: the
/// bounds hold for matrices of any condition.
class ConditionChooser final : public LightChooser {
 public:
  ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins)
      : basis_(basis), groups_(basis, bins, {}), k_(basis.components()) {
    const auto stride = static_cast<std::size_t>(groups_.rows().stride);
    gram_.assign(static_cast<std::size_t>(k_) * stride, 0.0);
    work_ = gram_;
    energy_.assign(groups_.rows().data.size() / stride, 0.0);
    low_.assign(static_cast<std::size_t>(groups_.candidates()), 0.0);
    high_ = low_;
    stage_.assign(low_.size(), Stage::bounded);
    probe_.resize(static_cast<std::size_t>(groups_.groups()));
    group_gram_.resize(probe_.size());
    own_.assign(energy_.size(), 0);
  }

  Standing best(const std::vector<std::uint8_t>& open) override;
  void take(int candidate) override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  /// Bounded by its group's pair; by its own after a few iterations; by its own, converged.
  enum class Stage : std::uint8_t { bounded, refined, converged, decided };
  /// A pair of unit vectors with |Rx|² and |Ry|².
  struct Probe {
    Eigen::VectorXd x, y;  ///< (stride), zeros at the end; empty until the group is first looked at
    double low = 0, high = 0;
  };

  Probe refined(int candidate, const Probe& start, int iterations,
                std::span<const std::int32_t> group_cells);
  void gather_information(int candidate, std::span<const std::int32_t> group_cells);
  Probe refined_by_qr(int candidate, Probe probe) const;
  void apply(const Probe& probe, const std::vector<int>& members,
             std::span<const std::int32_t> cells);
  void bound_group(std::size_t group, const CandidateGroups::Distinct& distinct);
  double bound(int candidate) const;
  /// What is known of a candidate that was decided, kept until one is taken.
  struct Decision {
    int candidate = -1, rank = 0;
    Eigen::MatrixXd R;
  };

  Standing decide(int candidate);
  void decide_deficient(const std::vector<int>& active, std::vector<Standing>& standings);
  Eigen::MatrixXd factor_with(std::span<const std::int32_t> cells) const;
  double energy_of_taken(const Eigen::VectorXd& x) const {
    return R_.rows() > 0 ? (R_ * x.head(k_)).squaredNorm() : 0.0;
  }

  const BrdfBasis& basis_;
  CandidateGroups groups_;
  Eigen::Index k_;
  Eigen::MatrixXd R_;                            ///< QR factor of the rows taken, (≤ k × k)
  std::vector<double> gram_;                     ///< RᵀR, upper triangle, for refinement only
  std::vector<std::vector<double>> group_gram_;  ///< with all that a group adds; empty: not needed
  std::vector<double> work_;
  std::vector<std::uint8_t> own_;  ///< (packed cells) all zero between calls
  std::vector<std::int32_t> lacking_;
  std::vector<double> energy_;  ///< (packed cells) of the probe at hand
  std::vector<double> low_;     ///< (candidates) upper bound of λmin
  std::vector<double> high_;    ///< (candidates) lower bound of λmax
  std::vector<Stage> stage_;
  std::vector<Probe> probe_;  ///< (groups)
  std::vector<Decision> decisions_;
  int rank_ = 0;  ///< of the rows taken
  SelectionStatistics statistics_;
};

/// R of [R; rows of these cells], (min(rows, k) × k).
Eigen::MatrixXd ConditionChooser::factor_with(std::span<const std::int32_t> cells) const {
  const PackedRows& rows = groups_.rows();
  const Eigen::Index added = static_cast<Eigen::Index>(cells.size()) * rows.per_cell;
  Eigen::MatrixXd stacked(R_.rows() + added, k_);
  stacked.topRows(R_.rows()) = R_;
  Eigen::Index row = R_.rows();
  for (const std::int32_t cell : cells) {
    const Eigen::Map<const Eigen::MatrixXd> of_cell(rows.of(cell), rows.stride, rows.per_cell);
    stacked.middleRows(row, rows.per_cell) = of_cell.topRows(k_).transpose();
    row += rows.per_cell;
  }
  if (stacked.rows() <= k_) return stacked;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(stacked);
  return qr.matrixQR().topRows(k_).triangularView<Eigen::Upper>();
}

void ConditionChooser::take(int candidate) {
  const auto known = std::find_if(decisions_.begin(), decisions_.end(),
                                  [&](const Decision& d) { return d.candidate == candidate; });
  if (known == decisions_.end()) {  // a light captured already: nobody chose it here
    decide(candidate);
    --statistics_.exact_evaluations;
    R_ = decisions_.back().R;
    rank_ = decisions_.back().rank;
  } else {
    R_ = known->R;
    rank_ = known->rank;
  }
  decisions_.clear();
  for (std::vector<double>& of_group : group_gram_) of_group.clear();
  const std::vector<std::int32_t> added = groups_.take(candidate);
  add_gram(groups_.rows(), added, gram_, vector_level());
  for (Probe& probe : probe_) {
    if (probe.x.size() == 0) continue;
    probe.low = energy_of_taken(probe.x);
    probe.high = energy_of_taken(probe.y);
  }
}

/// The extreme vectors of A + B by QR and triangular solves: for what Cholesky cannot factor.
ConditionChooser::Probe ConditionChooser::refined_by_qr(int candidate, Probe probe) const {
  const Eigen::MatrixXd R = factor_with(groups_.fresh(candidate));
  if (R.rows() < k_) return probe;
  Eigen::VectorXd x = probe.x.head(k_);
  for (int i = 0; i < 8; ++i) {
    Eigen::VectorXd z = R.transpose().triangularView<Eigen::Lower>().solve(x);
    z = R.triangularView<Eigen::Upper>().solve(z);
    const double length = z.stableNorm();
    if (!std::isfinite(length) || !(length > 0)) break;
    x = z / length;
  }
  probe.x.head(k_) = x;
  return probe;
}

/// work_ = A + B: the rows of the candidate's whole group, summed once per light, less those that
/// the candidate lacks, where these are the fewer. Good enough for a refinement: whatever vectors
/// come of it, bounds take them through sums of squares.
void ConditionChooser::gather_information(int candidate,
                                          std::span<const std::int32_t> group_cells) {
  const std::span<const std::int32_t> own = groups_.fresh(candidate);
  if (2 * (group_cells.size() - own.size()) >= own.size()) {
    work_ = gram_;
    add_gram(groups_.rows(), own, work_, vector_level());
    return;
  }
  const auto g = static_cast<std::size_t>(groups_.group_of(candidate));
  if (group_gram_[g].empty()) {
    group_gram_[g] = gram_;
    add_gram(groups_.rows(), group_cells, group_gram_[g], vector_level());
  }
  for (const std::int32_t cell : own) own_[static_cast<std::size_t>(cell)] = 1;
  lacking_.clear();
  for (const std::int32_t cell : group_cells) {
    if (own_[static_cast<std::size_t>(cell)] == 0) lacking_.push_back(cell);
  }
  for (const std::int32_t cell : own) own_[static_cast<std::size_t>(cell)] = 0;
  work_ = group_gram_[g];
  add_gram(groups_.rows(), lacking_, work_, vector_level(), -1);
}

/// The extreme vectors of A + B, as far as a few iterations from a neighbour's take them.
ConditionChooser::Probe ConditionChooser::refined(int candidate, const Probe& start, int iterations,
                                                  std::span<const std::int32_t> group_cells) {
  const PackedRows& rows = groups_.rows();
  gather_information(candidate, group_cells);
  const Lower A(work_.data(), k_, k_, Eigen::OuterStride<>(rows.stride));
  Probe probe = start;
  if (probe.x.size() == 0) {
    // Any start with a part in every direction will do.
    probe.x = Eigen::VectorXd::Zero(rows.stride);
    for (Eigen::Index i = 0; i < k_; ++i) probe.x[i] = 1 + 0.5 * std::sin(1.0 + 3.0 * double(i));
    probe.x.normalize();
    probe.y = probe.x;
  }
  Eigen::VectorXd y = probe.y.head(k_);
  double top = 0;
  for (int i = 0; i < iterations; ++i) {
    const Eigen::VectorXd z = A.selfadjointView<Eigen::Lower>() * y;
    const double length = z.stableNorm();
    if (!(length > 0)) break;
    y = z / length;
    if (length - top <= 1e-3 * length && i >= 2) break;
    top = length;
  }
  probe.y.head(k_) = y;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(A);
  bool by_qr = cholesky.info() != Eigen::Success;
  Eigen::VectorXd x = probe.x.head(k_);
  double last = std::numeric_limits<double>::infinity();
  for (int i = 0; i < iterations && !by_qr; ++i) {
    const Eigen::VectorXd z = cholesky.solve(x);
    const double length = z.stableNorm();  // rows of any size: squares may leave the range
    by_qr = !(length > 0) || !std::isfinite(length);
    if (by_qr) break;
    const double quotient = (z / length).dot(x) / length;
    by_qr = !(quotient > 1e-10 * top);
    x = z / length;
    if (last - quotient <= 1e-7 * quotient) break;
    last = quotient;
  }
  if (by_qr) {
    probe = refined_by_qr(candidate, probe);
  } else {
    probe.x.head(k_) = x;
  }
  probe.low = energy_of_taken(probe.x);
  probe.high = energy_of_taken(probe.y);
  return probe;
}

/// Tightens the bounds of candidates by one probe; `cells` holds at least all that they add.
void ConditionChooser::apply(const Probe& probe, const std::vector<int>& members,
                             std::span<const std::int32_t> cells) {
  const auto energies = [&](const Eigen::VectorXd& x) {
    std::vector<double> packed(cells.size());
    cell_energies(groups_.rows(), cells, {x.data(), static_cast<std::size_t>(x.size())}, packed,
                  vector_level());
    for (std::size_t i = 0; i < cells.size(); ++i) {
      energy_[static_cast<std::size_t>(cells[i])] = packed[i];
    }
  };
  const auto sum_over = [&](int candidate) {
    double sum = 0;
    for (const std::int32_t cell : groups_.fresh(candidate)) {
      sum += energy_[static_cast<std::size_t>(cell)];
    }
    return sum;
  };
  energies(probe.x);
  for (const int i : members) {
    double& low = low_[static_cast<std::size_t>(i)];
    low = std::min(low, probe.low + sum_over(i));
  }
  energies(probe.y);
  for (const int i : members) {
    double& high = high_[static_cast<std::size_t>(i)];
    high = std::max(high, probe.high + sum_over(i));
  }
}

/// Lower bound of κ², with room for the rounding of its sums.
double ConditionChooser::bound(int candidate) const {
  const auto i = static_cast<std::size_t>(candidate);
  const double rounding = static_cast<double>(k_) * std::numeric_limits<double>::epsilon();
  const double least = std::sqrt(low_[i]) + rounding * std::sqrt(high_[i]);
  return (1 - 1e-11) * high_[i] / (least * least);
}

Standing ConditionChooser::decide(int candidate) {
  ++statistics_.exact_evaluations;
  const std::span<const std::int32_t> cells = groups_.fresh(candidate);
  const Eigen::Index total =
      (groups_.seen_cells() + static_cast<Eigen::Index>(cells.size())) * groups_.rows().per_cell;
  const Eigen::MatrixXd R = factor_with(cells);
  const Conditioning found = conditioning_of(singular_values(R), total, k_);
  decisions_.push_back({candidate, found.rank, R});
  return {candidate, found.rank, found.pseudo_condition};
}

void ConditionChooser::bound_group(std::size_t group, const CandidateGroups::Distinct& distinct) {
  const std::vector<int>& members = distinct.members[group];
  if (members.empty()) return;
  for (const int i : members) {
    low_[static_cast<std::size_t>(i)] = std::numeric_limits<double>::infinity();
    high_[static_cast<std::size_t>(i)] = 0;
    stage_[static_cast<std::size_t>(i)] = Stage::bounded;
  }
  if (probe_[group].x.size() == 0) {
    const int largest = *std::max_element(members.begin(), members.end(), [&](int a, int b) {
      return groups_.fresh(a).size() < groups_.fresh(b).size();
    });
    probe_[group] = refined(largest, probe_[group], converging, distinct.cells[group]);
  }
  apply(probe_[group], members, distinct.cells[group]);
}

/// No candidate reaches full rank: the rank decides, and its bound is the number of rows.
void ConditionChooser::decide_deficient(const std::vector<int>& active,
                                        std::vector<Standing>& standings) {
  const auto rank_bound = [&](int i) {
    const std::size_t rows =
        groups_.fresh(i).size() * static_cast<std::size_t>(groups_.rows().per_cell);
    return std::min<std::int64_t>(k_, rank_ + static_cast<std::int64_t>(rows));
  };
  std::vector<int> open;
  for (const int i : active) {
    if (stage_[static_cast<std::size_t>(i)] != Stage::decided) open.push_back(i);
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

Standing ConditionChooser::best(const std::vector<std::uint8_t>& open) {
  const CandidateGroups::Distinct distinct = groups_.distinct(open);
  for (std::vector<double>& of_group : group_gram_) of_group.clear();
  statistics_.identical_candidates += distinct.identical;
  statistics_.empty_candidates += distinct.empty;
  std::vector<int> active;
  for (std::size_t g = 0; g < distinct.members.size(); ++g) {
    bound_group(g, distinct);
    active.insert(active.end(), distinct.members[g].begin(), distinct.members[g].end());
  }
  std::vector<double> bound_of(low_.size(), 0.0);
  for (const int i : active) bound_of[static_cast<std::size_t>(i)] = bound(i);

  decisions_.clear();
  std::vector<Standing> standings;
  Standing leader;  // best of full rank
  const double epsilon = std::numeric_limits<double>::epsilon();
  while (true) {
    int next = -1;
    for (const int i : active) {
      const auto u = static_cast<std::size_t>(i);
      if (stage_[u] == Stage::decided) continue;
      if (next < 0 || bound_of[u] < bound_of[static_cast<std::size_t>(next)]) next = i;
    }
    if (next < 0) break;
    const auto u = static_cast<std::size_t>(next);
    if (leader.candidate >= 0) {
      if (bound_of[u] > leader.score * (1 + 2 * tie_tolerance(leader.score))) break;
    } else {
      const double rows = static_cast<double>(std::max<Eigen::Index>(
          k_, (groups_.seen_cells() + Eigen::Index(groups_.fresh(next).size())) *
                  groups_.rows().per_cell));
      if (bound_of[u] > 0.25 / (rows * epsilon * rows * epsilon)) {
        // The least bound is already beyond what counts as full rank.
        decide_deficient(active, standings);
        break;
      }
    }
    if (stage_[u] == Stage::bounded || stage_[u] == Stage::refined) {
      const auto g = static_cast<std::size_t>(groups_.group_of(next));
      const bool first = stage_[u] == Stage::bounded;
      probe_[g] = refined(next, probe_[g], first ? glancing : converging, distinct.cells[g]);
      stage_[u] = first ? Stage::refined : Stage::converged;
      apply(probe_[g], distinct.members[g], distinct.cells[g]);
      for (const int i : distinct.members[g]) bound_of[static_cast<std::size_t>(i)] = bound(i);
      continue;
    }
    stage_[u] = Stage::decided;
    standings.push_back(decide(next));
    const Standing& found = standings.back();
    if (found.rank == k_ && (leader.candidate < 0 || found.score < leader.score)) leader = found;
  }
  statistics_.bounded_away += static_cast<std::int64_t>(active.size() - standings.size());
  return best_of(standings);
}

}  // namespace

std::unique_ptr<LightChooser> make_condition_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& /*options*/) {
  return std::make_unique<ConditionChooser>(basis, bins);
}

}  // namespace lightrig
