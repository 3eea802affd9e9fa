#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/candidate_groups.h"
#include "core/extreme_pair.h"
#include "core/group_extremes.h"
#include "core/planner_chooser.h"
#include "core/planner_kernels.h"
#include "core/taken_rows.h"

namespace lightrig {

/// The condition criterion, exactly and with little work. With A = RᵀR of the lights taken and B of
/// the rows that a candidate adds, for any unit vectors x and y
///
///     λmin(A + B) ≤ |Rx|² + Σ (g·x)²,    λmax(A + B) ≥ |Ry|² + Σ (g·y)²,
///
/// so every pair (x, y) bounds κ² of every candidate from below, at one number per cell. A group of
/// candidates shares a pair: the extreme vectors of all that the group would add; where candidates
/// lack few of its cells, only these are looked at. The candidate of least bound is refined (its
/// own extreme vectors become the group's pair) and, when its refined bound is still the least,
/// decided: by the eigenvalues of A + B where these tell κ², else by the singular values of
/// [R; rows]. So do refined bounds: where A is well conditioned they may be quadratic forms of it,
/// with room for what cancels; else they are sums of squares and hold for matrices of any
/// condition.
class ConditionChooser final : public LightChooser {
 public:
  ConditionChooser(const BrdfBasis& basis, const CandidateBins& bins,
                   const SelectionOptions& options);

  Standing best(const std::vector<std::uint8_t>& open) override;
  void stand_on(const Eigen::MatrixXd& rows) override;
  void take(std::span<const int> candidates) override;
  Standing standing() override;
  Eigen::MatrixXd information() const override;
  void restart() override;
  const std::vector<std::uint8_t>& seen() const override { return groups_.seen(); }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  /// Iterations of a first look at a candidate, which most do not survive, and of a thorough one.
  static constexpr int glancing_iterations = 3, thorough_iterations = 30;

  /// Bounded by its group's pair; by its own after a few iterations; by its own, converged.
  enum class Stage : std::uint8_t { bounded, refined, converged, decided };

  /// What candidates of one group share; the energies are of the cells of the group.
  struct Group {
    ExtremePair pair;
    double low = 0, high = 0;  ///< |Rx|² and |Ry|²
    std::vector<double> of_x, of_y;
    int next = -1;  ///< candidate of least bound that is not decided
    double bound =
        std::numeric_limits<double>::infinity();  ///< lower bound of κ² of those not decided
  };
  /// What is known of a candidate that was decided, kept until one is taken.
  struct Decision {
    int candidate = -1;
    Conditioning found;
    PackedRows R;  ///< empty where the Gram matrix told enough
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
  Standing decide(int candidate);
  void decide_deficient(const std::vector<int>& active, std::vector<Standing>& standings);
  void list_unseen(int group);
  Eigen::Index rows_with(std::size_t cells) const {
    return taken_.count() + static_cast<Eigen::Index>(cells) * groups_.rows().per_cell;
  }
  Stage& stage_of(int candidate) { return stage_[static_cast<std::size_t>(candidate)]; }
  Group& group_at(int g) { return group_[static_cast<std::size_t>(g)]; }

  Eigen::VectorXd scale_;  ///< s/σ
  CandidateGroups groups_;
  int k_, stride_, level_, threads_;
  GroupExtremes extremes_;
  TakenRows taken_;
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
  int rank_ = 0;        ///< of the rows taken, −1: not known
  bool plain_ = false;  ///< their Gram matrix is known to tell κ²
  SelectionStatistics statistics_;
};

}  // namespace lightrig
