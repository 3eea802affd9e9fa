#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/candidate_groups.h"
#include "core/check.h"
#include "core/parallel.h"
#include "core/planner_chooser.h"
#include "core/symmetric_kernels.h"

namespace lightrig {

namespace {

/// Directions of the posterior that bounds of k components look at together, from a glance to a
/// long look, as long as that is less work than all of them.
std::vector<int> heads_of(int k) {
  std::vector<int> heads;
  for (const int head : {0, 8, 16, 32, 64, 128}) {
    if (8 * head >= k - 8 && 4 * head <= 3 * k) heads.push_back(head);
  }
  return heads;
}

/// Candidates looked at together: the same number whatever the threads, so that what was evaluated
/// does not depend on them.
constexpr std::size_t at_once = 8;

std::size_t size_of(int k, int stride) {
  return static_cast<std::size_t>(k) * static_cast<std::size_t>(stride);
}

/// The posterior trace, exactly and with little work. With rows w = g diag(s)/σ and A = I + Σ w wᵀ
/// of the lights taken, a candidate's trace is f = tr(S (A + WᵀW)⁻¹ S). In the directions of the
/// posterior of the lights taken, the eigenvectors Y of L⁻¹S²L⁻ᵀ = YΛYᵀ with A = LLᵀ, this is
///
///     f = Σ λₖ (M⁻¹)ₖₖ,   M = I + BᵀB,   B = W L⁻ᵀ Y,
///
/// and Λ falls off so fast that a few directions, the head H, tell nearly all:
///
///     f ≥ Σ_{k ∈ H} λₖ (M_HH⁻¹)ₖₖ + Σ_{k ∉ H} λₖ / Mₖₖ,
///
/// by Schur's complement. The candidate of least bound is bounded by a longer head, and in the end
/// evaluated, until no bound is below the best value.
class AOptimalChooser final : public LightChooser {
 public:
  AOptimalChooser(const BrdfBasis& basis, const CandidateBins& bins,
                  const SelectionOptions& options)
      : scale_(basis.stddev / options.sigma),
        groups_(basis, bins, {scale_.data(), static_cast<std::size_t>(scale_.size())},
                std::max(1, options.threads)),
        s_(basis.stddev),
        heads_(heads_of(groups_.rows().k)),
        threads_(std::max(1, options.threads)),
        level_(vector_level()) {
    CHECK(options.sigma > 0);
    const PackedRows& rows = groups_.rows();
    prior_.assign(static_cast<std::size_t>(rows.stride), 0.0);
    std::copy_n(s_.cwiseAbs2().eval().data(), rows.k, prior_.begin());
    reset();
    bound_.assign(static_cast<std::size_t>(groups_.candidates()), 0.0);
    stage_.assign(bound_.size(), 0);
    scratch_.resize(static_cast<std::size_t>(threads_));
    for (Scratch& scratch : scratch_) {
      scratch.A.resize(gram_.size());
      scratch.inverse.resize(gram_.size());
      scratch.energy.resize(static_cast<std::size_t>(rows.stride));
    }
  }

  Standing best(const std::vector<std::uint8_t>& open) override;
  void stand_on(const Eigen::MatrixXd& rows) override;
  void take(std::span<const int> candidates) override;
  Standing standing() override;
  Eigen::MatrixXd information() const override {
    return Eigen::Map<const Eigen::MatrixXd>(gram_.data(), groups_.rows().stride, groups_.rows().k)
        .topRows(groups_.rows().k);
  }
  void restart() override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  /// Memory that one worker uses again for every candidate.
  struct Scratch {
    std::vector<double> A, inverse, energy;
  };

  void reset();
  void turn_to_posterior();
  double bound_by_head(int candidate, int head, Scratch& scratch) const;
  double trace_with(int candidate, Scratch& scratch) const;
  void look_closer(std::span<const int> candidates);
  bool decided(int candidate) const {
    return stage_[static_cast<std::size_t>(candidate)] > static_cast<int>(heads_.size());
  }
  /// Rows in the posterior's directions; the packed ones themselves while nothing is taken.
  const PackedRows& turned() const { return turned_.data.empty() ? groups_.rows() : turned_; }

  Eigen::VectorXd scale_;  ///< s/σ
  CandidateGroups groups_;
  Eigen::VectorXd s_;
  std::vector<int> heads_;
  int threads_, level_;
  std::vector<double> gram_;   ///< A of the rows taken, upper triangle, (k × stride)
  std::vector<double> prior_;  ///< s², (stride)
  PackedRows turned_;
  std::vector<double> variance_;  ///< Λ, descending, (stride)
  double rounding_ = 0;           ///< how far bounds may be off, absolute
  double trace_of_A_ = 0;
  bool posterior_is_old_ = false;
  bool stands_on_rows_ = false;
  std::vector<double> bound_;  ///< (candidates): of the score; the score itself once decided
  std::vector<int> stage_;     ///< (candidates): heads looked at, or all of them and more: decided
  std::vector<Scratch> scratch_;
  SelectionStatistics statistics_;
};

Standing AOptimalChooser::standing() {
  if (groups_.seen_cells() == 0 && !stands_on_rows_) return {};
  const PackedRows& rows = groups_.rows();
  std::vector<double> A = gram_, inverse(gram_.size());
  CHECK(cholesky(A, rows.k, rows.stride, level_));
  return {-1, 0, trace_of_inverse(A, rows.k, rows.stride, prior_, inverse, level_)};
}

void AOptimalChooser::restart() {
  groups_.restart();
  reset();
}

void AOptimalChooser::reset() {
  const PackedRows& rows = groups_.rows();
  gram_.assign(size_of(rows.k, rows.stride), 0.0);
  for (int i = 0; i < rows.k; ++i) gram_[static_cast<std::size_t>(i * rows.stride + i)] = 1.0;
  variance_ = prior_;
  turned_.data.clear();
  rounding_ = trace_of_A_ = 0;
  posterior_is_old_ = stands_on_rows_ = false;
  statistics_ = {};
}

void AOptimalChooser::stand_on(const Eigen::MatrixXd& rows) {
  if (rows.rows() == 0) return;
  const int k = groups_.rows().k, stride = groups_.rows().stride;
  const Eigen::MatrixXd W = rows * scale_.asDiagonal();
  Eigen::Map<Eigen::MatrixXd, Eigen::Unaligned, Eigen::OuterStride<>>(gram_.data(), k, k,
                                                                      Eigen::OuterStride<>(stride))
      .selfadjointView<Eigen::Lower>()
      .rankUpdate(W.transpose());
  posterior_is_old_ = stands_on_rows_ = true;
}

void AOptimalChooser::take(std::span<const int> candidates) {
  const std::span<const std::int32_t> added = groups_.take(candidates);
  add_gram(groups_.rows(), added, gram_, level_);
  posterior_is_old_ = posterior_is_old_ || !added.empty();
}

/// Λ and B's rows, after lights were taken.
void AOptimalChooser::turn_to_posterior() {
  posterior_is_old_ = false;
  const PackedRows& rows = groups_.rows();
  const int k = rows.k, stride = rows.stride;
  Scratch& scratch = scratch_.front();
  scratch.A = gram_;
  CHECK(cholesky(scratch.A, k, stride, level_));
  invert_factor(scratch.A, k, stride, scratch.inverse, level_);  // L⁻¹
  const Eigen::Map<const Eigen::MatrixXd, Eigen::Unaligned, Eigen::OuterStride<>> transposed(
      scratch.inverse.data(), k, k, Eigen::OuterStride<>(stride));  // L⁻ᵀ, by columns
  const Eigen::MatrixXd F = (s_.asDiagonal() * transposed).transpose();
  Eigen::MatrixXd posterior = Eigen::MatrixXd::Zero(k, k);
  posterior.selfadjointView<Eigen::Lower>().rankUpdate(F);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(posterior);
  CHECK(eigen.info() == Eigen::Success);
  std::fill(variance_.begin(), variance_.end(), 0.0);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> T =
      Eigen::MatrixXd::Zero(k, stride);
  T.leftCols(k).noalias() =
      transposed.triangularView<Eigen::Upper>() * eigen.eigenvectors().rowwise().reverse();
  for (int i = 0; i < k; ++i) {
    variance_[static_cast<std::size_t>(i)] = std::max(0.0, eigen.eigenvalues()[k - 1 - i]);
  }
  trace_of_A_ = 0;
  for (int i = 0; i < k; ++i) trace_of_A_ += gram_[static_cast<std::size_t>(i * stride + i)];
  // |f(Λ + E) − f(Λ)| ≤ k|E|, since M ≥ I; |E| is a few ε|Λ|.
  rounding_ = 64 * std::numeric_limits<double>::epsilon() * k * variance_[0];
  if (turned_.data.empty()) {
    turned_ = rows;
  }
  std::vector<std::int32_t> unseen_cells;
  const auto cells = static_cast<std::int32_t>(rows.data.size() / size_of(rows.per_cell, stride));
  for (std::int32_t c = 0; c < cells; ++c) {
    if (!groups_.packed_seen(c)) unseen_cells.push_back(c);
  }
  parallel_ranges(
      static_cast<std::int64_t>(unseen_cells.size()), 256, threads_,
      [&](std::int64_t first, std::int64_t last, int) {
        transform_rows(
            rows,
            std::span(unseen_cells)
                .subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(last - first)),
            {T.data(), static_cast<std::size_t>(T.size())}, turned_.data, level_);
      });
}

double AOptimalChooser::bound_by_head(int candidate, int head, Scratch& scratch) const {
  const PackedRows& rows = turned();
  const std::span<const std::int32_t> cells = groups_.fresh(candidate);
  const std::span<double> M = std::span(scratch.A).first(size_of(head, head));
  std::fill(M.begin(), M.end(), 0.0);
  double largest = 0;
  add_head_gram(rows, cells, head, M, level_);
  for (int i = 0; i < head; ++i) {
    double& diagonal = M[static_cast<std::size_t>(i * head + i)];
    largest += diagonal;
    diagonal += 1.0;
  }
  if (!cholesky(M, head, head, level_)) return 0;
  double bound = trace_of_inverse(M, head, head, variance_, scratch.inverse, level_);
  const std::span<double> energy =
      std::span(scratch.energy).first(static_cast<std::size_t>(rows.stride - head));
  column_energies(rows, cells, head, energy, level_);
  for (std::size_t j = 0; j < energy.size(); ++j) {
    bound += variance_[static_cast<std::size_t>(head) + j] / (1 + energy[j]);
  }
  const double relative =
      1e-11 + 8 * std::numeric_limits<double>::epsilon() * (trace_of_A_ + largest);
  return (1 - relative) * bound - rounding_;
}

double AOptimalChooser::trace_with(int candidate, Scratch& scratch) const {
  const PackedRows& rows = groups_.rows();
  std::copy(gram_.begin(), gram_.end(), scratch.A.begin());
  add_gram(rows, groups_.fresh(candidate), scratch.A, level_);
  CHECK(cholesky(scratch.A, rows.k, rows.stride, level_));
  return trace_of_inverse(scratch.A, rows.k, rows.stride, prior_, scratch.inverse, level_);
}

/// Bounds each of these by its next head, or decides it where that would be no less work.
void AOptimalChooser::look_closer(std::span<const int> candidates) {
  parallel_ranges(
      static_cast<std::int64_t>(candidates.size()), 1, threads_,
      [&](std::int64_t first, std::int64_t last, int worker) {
        Scratch& scratch = scratch_[static_cast<std::size_t>(worker)];
        for (auto n = static_cast<std::size_t>(first); n < static_cast<std::size_t>(last); ++n) {
          const auto i = static_cast<std::size_t>(candidates[n]);
          const auto stage = static_cast<std::size_t>(stage_[i]);
          if (stage < heads_.size()) {
            bound_[i] = std::max(bound_[i], bound_by_head(candidates[n], heads_[stage], scratch));
            ++stage_[i];
          } else {
            bound_[i] = trace_with(candidates[n], scratch);
            stage_[i] = static_cast<int>(heads_.size()) + 1;
          }
        }
      });
}

Standing AOptimalChooser::best(const std::vector<std::uint8_t>& open) {
  if (posterior_is_old_) turn_to_posterior();
  const CandidateGroups::Distinct& distinct = groups_.distinct(open);
  statistics_.identical_candidates += distinct.identical;
  statistics_.empty_candidates += distinct.empty;
  const std::vector<int>& active = distinct.candidates;
  for (const int i : active) {
    bound_[static_cast<std::size_t>(i)] = 0;
    stage_[static_cast<std::size_t>(i)] = 0;
  }
  look_closer(active);
  std::vector<int> open_still = active;
  std::vector<Standing> standings;
  double least = std::numeric_limits<double>::infinity();
  while (true) {
    std::erase_if(open_still, [&](int i) {
      const double value = bound_[static_cast<std::size_t>(i)];
      if (!decided(i)) return value > least * (1 + 2 * tie_tolerance(0));
      standings.push_back({i, 0, value});
      ++statistics_.exact_evaluations;
      return true;
    });
    for (const Standing& s : standings) least = std::min(least, s.score);
    const std::size_t n = std::min(at_once, open_still.size());
    if (n == 0) break;
    std::partial_sort(open_still.begin(), open_still.begin() + static_cast<std::ptrdiff_t>(n),
                      open_still.end(), [&](int a, int b) {
                        const double of_a = bound_[static_cast<std::size_t>(a)],
                                     of_b = bound_[static_cast<std::size_t>(b)];
                        return of_a != of_b ? of_a < of_b : a < b;
                      });
    const double limit = least * (1 + 2 * tie_tolerance(0));
    std::size_t below = 0;  // the limit; they are in order
    while (below < n && !(bound_[static_cast<std::size_t>(open_still[below])] > limit)) ++below;
    if (below == 0) break;
    look_closer(std::span(open_still).first(below));
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
