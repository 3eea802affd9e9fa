#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/candidate_groups.h"
#include "core/check.h"
#include "core/planner_chooser.h"
#include "core/planner_kernels.h"

namespace lightrig {

namespace {

/// Components that bounds look at one by one; those behind have so little prior variance that one
/// number per cell says enough of them.
constexpr Eigen::Index head_components = 48;

/// The posterior trace, exactly and with little work. With rows w = g diag(s)/σ and A = I + Σ w wᵀ
/// the trace is f(A) = tr(S A⁻¹ S), convex in A: for any other Y = I + …
///
///     f(A) ≥ tr(S Y⁻¹ S)² / tr(S Y⁻¹ A Y⁻¹ S),
///
/// and the denominator is a sum of one number per cell, |S Y⁻¹ w|². So every candidate looked at
/// closely bounds all that show much the same. Components beyond the head enter by (A⁻¹)ₖₖ ≥ 1/Aₖₖ
/// ≥ 2 − Aₖₖ, again one number per cell. The candidate of least bound is evaluated, until no bound
/// is below the best value.
class AOptimalChooser final : public LightChooser {
 public:
  AOptimalChooser(const BrdfBasis& basis, const CandidateBins& bins,
                  const SelectionOptions& options)
      : scale_(basis.stddev / options.sigma),
        groups_(basis, bins, {scale_.data(), static_cast<std::size_t>(scale_.size())}),
        s_(basis.stddev),
        k_(basis.components()),
        head_(std::min(k_, head_components)) {
    CHECK(options.sigma > 0);
    const PackedRows& rows = groups_.rows();
    gram_.assign(static_cast<std::size_t>(k_) * static_cast<std::size_t>(rows.stride), 0.0);
    for (Eigen::Index i = 0; i < k_; ++i)
      gram_[static_cast<std::size_t>(i * rows.stride + i)] = 1.0;
    const auto cells = rows.data.size() / (static_cast<std::size_t>(rows.stride) *
                                           static_cast<std::size_t>(rows.per_cell));
    tail_.assign(cells, 0.0);
    for (std::size_t c = 0; c < cells && head_ < k_; ++c) {
      const Eigen::Map<const Eigen::MatrixXd> w = rows_of(static_cast<std::int32_t>(c));
      const Eigen::VectorXd energy = w.middleRows(head_, k_ - head_).rowwise().squaredNorm();
      tail_[c] = energy.dot(s_.tail(k_ - head_).cwiseAbs2());
    }
    tail_left_ = s_.tail(k_ - head_).squaredNorm();
    cut_.resize(static_cast<std::size_t>(groups_.groups()));
    table_.assign(cells, 0.0);
    bound_.assign(static_cast<std::size_t>(groups_.candidates()), 0.0);
    stage_.assign(bound_.size(), Stage::bounded);
  }

  Standing best(const std::vector<std::uint8_t>& open) override;
  void take(int candidate) override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  enum class Stage : std::uint8_t { bounded, cut, decided };
  /// A tangent of f over the head: Z = Y⁻¹S, tr(S Y⁻¹ S) and tr(Zᵀ A Z) of the rows taken.
  struct Cut {
    Eigen::MatrixXd Z;  ///< (head × head); empty until the group is first looked at
    double trace = 0, constant = 0;
  };

  Eigen::Map<const Eigen::MatrixXd> rows_of(std::int32_t cell) const {
    return {groups_.rows().of(cell), groups_.rows().stride, groups_.rows().per_cell};
  }
  Eigen::MatrixXd head_rows(std::span<const std::int32_t> cells) const;
  Eigen::MatrixXd information_with(int candidate) const;
  Cut cut_at(int candidate) const;
  void apply(const Cut& cut, const std::vector<int>& members, std::span<const std::int32_t> cells);
  Standing decide(int candidate);

  Eigen::VectorXd scale_;  ///< s/σ
  CandidateGroups groups_;
  Eigen::VectorXd s_;
  Eigen::Index k_, head_;
  std::vector<double> gram_;   ///< A of the rows taken, upper triangle, (k × stride)
  std::vector<double> tail_;   ///< (packed cells): what a cell can take from the tail's variance
  double tail_left_ = 0;       ///< least tail variance with the rows taken
  std::vector<Cut> cut_;       ///< (groups)
  std::vector<double> table_;  ///< (packed cells) of the cut at hand
  std::vector<double> bound_;  ///< (candidates)
  std::vector<Stage> stage_;
  SelectionStatistics statistics_;
};

/// The head of the rows of these cells as columns, (head × rows).
Eigen::MatrixXd AOptimalChooser::head_rows(std::span<const std::int32_t> cells) const {
  const int per_cell = groups_.rows().per_cell;
  Eigen::MatrixXd W(head_, static_cast<Eigen::Index>(cells.size()) * per_cell);
  Eigen::Index column = 0;
  for (const std::int32_t cell : cells) {
    W.middleCols(column, per_cell) = rows_of(cell).topRows(head_);
    column += per_cell;
  }
  return W;
}

/// A with a candidate's rows, (k × k), its lower triangle valid.
Eigen::MatrixXd AOptimalChooser::information_with(int candidate) const {
  std::vector<double> sum = gram_;
  add_gram(groups_.rows(), groups_.fresh(candidate), sum, vector_level());
  // Row-major above the diagonal is column-major below it.
  return Eigen::Map<const Eigen::MatrixXd, Eigen::Unaligned, Eigen::OuterStride<>>(
      sum.data(), k_, k_, Eigen::OuterStride<>(groups_.rows().stride));
}

AOptimalChooser::Cut AOptimalChooser::cut_at(int candidate) const {
  const Eigen::MatrixXd A = information_with(candidate);
  const Eigen::LLT<Eigen::MatrixXd> cholesky(A.topLeftCorner(head_, head_));
  CHECK(cholesky.info() == Eigen::Success);
  Cut cut;
  const Eigen::MatrixXd S = s_.head(head_).asDiagonal();
  cut.Z = cholesky.solve(S);
  cut.trace = cut.Z.diagonal().dot(s_.head(head_));
  const Eigen::Map<const Eigen::MatrixXd, Eigen::Unaligned, Eigen::OuterStride<>> taken(
      gram_.data(), head_, head_, Eigen::OuterStride<>(groups_.rows().stride));
  const Eigen::MatrixXd product = taken.selfadjointView<Eigen::Lower>() * cut.Z;
  cut.constant = product.cwiseProduct(cut.Z).sum();
  return cut;
}

void AOptimalChooser::apply(const Cut& cut, const std::vector<int>& members,
                            std::span<const std::int32_t> cells) {
  const int per_cell = groups_.rows().per_cell;
  const Eigen::MatrixXd product = cut.Z.transpose() * head_rows(cells);
  const Eigen::RowVectorXd energy = product.colwise().squaredNorm();
  for (std::size_t c = 0; c < cells.size(); ++c) {
    table_[static_cast<std::size_t>(cells[c])] =
        energy.segment(static_cast<Eigen::Index>(c) * per_cell, per_cell).sum();
  }
  for (const int i : members) {
    double denominator = cut.constant, tail = tail_left_;
    for (const std::int32_t cell : groups_.fresh(i)) {
      denominator += table_[static_cast<std::size_t>(cell)];
      tail -= tail_[static_cast<std::size_t>(cell)];
    }
    const double least = cut.trace * cut.trace / denominator + std::max(0.0, tail);
    double& bound = bound_[static_cast<std::size_t>(i)];
    bound = std::max(bound, (1 - 1e-11) * least);
  }
}

Standing AOptimalChooser::decide(int candidate) {
  ++statistics_.exact_evaluations;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(information_with(candidate));
  CHECK(cholesky.info() == Eigen::Success);
  const Eigen::MatrixXd S = s_.asDiagonal();
  return {candidate, 0, cholesky.matrixL().solve(S).squaredNorm()};
}

void AOptimalChooser::take(int candidate) {
  const std::vector<std::int32_t> added = groups_.take(candidate);
  add_gram(groups_.rows(), added, gram_, vector_level());
  const Eigen::MatrixXd W = head_rows(added);
  for (Cut& cut : cut_) {
    if (cut.Z.size() > 0) cut.constant += (cut.Z.transpose() * W).squaredNorm();
  }
  for (const std::int32_t cell : added) tail_left_ -= tail_[static_cast<std::size_t>(cell)];
}

Standing AOptimalChooser::best(const std::vector<std::uint8_t>& open) {
  const CandidateGroups::Distinct distinct = groups_.distinct(open);
  statistics_.identical_candidates += distinct.identical;
  statistics_.empty_candidates += distinct.empty;
  std::vector<int> active;
  for (std::size_t g = 0; g < distinct.members.size(); ++g) {
    const std::vector<int>& members = distinct.members[g];
    if (members.empty()) continue;
    for (const int i : members) {
      bound_[static_cast<std::size_t>(i)] = 0;
      stage_[static_cast<std::size_t>(i)] = Stage::bounded;
    }
    if (cut_[g].Z.size() == 0) {
      cut_[g] = cut_at(*std::max_element(members.begin(), members.end(), [&](int a, int b) {
        return groups_.fresh(a).size() < groups_.fresh(b).size();
      }));
    }
    apply(cut_[g], members, distinct.cells[g]);
    active.insert(active.end(), members.begin(), members.end());
  }
  std::vector<Standing> standings;
  double least = std::numeric_limits<double>::infinity();
  while (true) {
    int next = -1;
    for (const int i : active) {
      if (stage_[static_cast<std::size_t>(i)] == Stage::decided) continue;
      if (next < 0 ||
          bound_[static_cast<std::size_t>(i)] < bound_[static_cast<std::size_t>(next)]) {
        next = i;
      }
    }
    if (next < 0) break;
    const auto u = static_cast<std::size_t>(next);
    if (bound_[u] > least * (1 + 2 * tie_tolerance(0))) break;
    if (stage_[u] == Stage::bounded) {
      const auto g = static_cast<std::size_t>(groups_.group_of(next));
      cut_[g] = cut_at(next);
      stage_[u] = Stage::cut;
      apply(cut_[g], distinct.members[g], distinct.cells[g]);
      continue;
    }
    stage_[u] = Stage::decided;
    standings.push_back(decide(next));
    least = std::min(least, standings.back().score);
  }
  statistics_.bounded_away += static_cast<std::int64_t>(active.size() - standings.size());
  return best_of(standings);
}

}  // namespace

std::unique_ptr<LightChooser> make_a_optimal_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& options) {
  return std::make_unique<AOptimalChooser>(basis, bins, options);
}

}  // namespace lightrig
