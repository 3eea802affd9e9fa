#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/planner_kernels.h"

namespace lightrig {

/// What the exact choosers keep of the candidates: the cells that each would add, as packed rows,
/// and groups of candidates that show much the same.
///
/// Candidates are grouped by their mean θd column. With a distant lamp and a distant view every
/// candidate is one column and a group is all lights of that column; with a near lamp or a
/// perspective camera groups overlap. Nothing depends on which: groups only share bounds.
class CandidateGroups {
 public:
  /// Rows are V's, their k-th number times `scale[k]` (empty: 1).
  CandidateGroups(const BrdfBasis& basis, const CandidateBins& bins, std::span<const double> scale,
                  int threads = 1);

  int candidates() const { return static_cast<int>(count_.size()); }
  int groups() const { return groups_; }
  int group_of(int candidate) const { return group_of_[static_cast<std::size_t>(candidate)]; }
  const PackedRows& rows() const { return rows_; }

  /// Packed cells that a candidate would add, ascending.
  std::span<const std::int32_t> fresh(int candidate) const { return part(fresh_, candidate); }

  /// Where the same cells stand among those of the candidate's group.
  std::span<const std::int32_t> places(int candidate) const { return part(place_, candidate); }

  /// Packed cells of all candidates of a group, ascending, seen or not.
  std::span<const std::int32_t> cells_of_group(int group) const {
    const auto g = static_cast<std::size_t>(group);
    return {group_cell_.data() + group_offset_[g], group_cell_.data() + group_offset_[g + 1]};
  }

  /// Packed cells of a group that some of its candidates do not show, and where those that a
  /// candidate lacks stand among them. Kept where candidates lack little; else empty, and lacking()
  /// is false.
  bool lacking(int group) const { return lacking_[static_cast<std::size_t>(group)] != 0; }
  std::span<const std::int32_t> edge(int group) const {
    const auto g = static_cast<std::size_t>(group);
    return {edge_.data() + edge_offset_[g], edge_.data() + edge_offset_[g + 1]};
  }
  std::span<const std::int32_t> lacks(int candidate) const {
    const auto i = static_cast<std::size_t>(candidate);
    return {lack_.data() + lack_offset_[i], static_cast<std::size_t>(lack_count_[i])};
  }

  /// All candidates of a group, ascending.
  std::span<const int> members(int group) const {
    const auto g = static_cast<std::size_t>(group);
    return {member_.data() + member_offset_[g], member_.data() + member_offset_[g + 1]};
  }

  /// Marks the cells of candidates as seen; returns the packed cells that were new, until the next
  /// call.
  std::span<const std::int32_t> take(std::span<const int> candidates);

  /// Nothing is seen again, as after construction.
  void restart();

  const std::vector<std::uint8_t>& seen() const { return seen_; }
  int seen_cells() const { return seen_cells_; }
  const std::vector<std::uint8_t>& seen_packed() const { return seen_packed_; }
  bool packed_seen(std::int32_t packed) const {
    return seen_packed_[static_cast<std::size_t>(packed)] != 0;
  }

  /// The open candidates that add a cell, the first of each set that adds the same cells.
  struct Distinct {
    std::vector<int> candidates;  ///< by group, ascending within
    std::vector<int> offset;      ///< (groups + 1)
    std::int64_t identical = 0, empty = 0;

    std::span<const int> of_group(int group) const {
      const auto g = static_cast<std::size_t>(group);
      return {candidates.data() + offset[g], candidates.data() + offset[g + 1]};
    }
  };

  /// Valid until the next call.
  const Distinct& distinct(const std::vector<std::uint8_t>& open);

 private:
  struct Entry {
    std::uint64_t hash;
    int candidate;
  };

  std::span<const std::int32_t> part(const std::vector<std::int32_t>& of, int candidate) const {
    const auto i = static_cast<std::size_t>(candidate);
    return {of.data() + offset_[i], static_cast<std::size_t>(count_[i])};
  }
  void group(const CandidateBins& bins, const std::vector<std::int32_t>& packed);
  void lay_places();
  void find_lacks();
  void leave_out_seen(int group);
  void sort_entries();

  PackedRows rows_;
  std::vector<std::int32_t> grid_cell_;  ///< packed → grid
  std::vector<std::int64_t> offset_;
  std::vector<std::int32_t> fresh_, place_, count_;
  std::vector<std::int32_t> all_fresh_, all_places_;  ///< before anything was seen
  std::vector<std::uint64_t> hash_;                   ///< (candidates) of fresh(), 0: not known
  std::vector<int> group_of_;
  int groups_ = 0;
  std::vector<int> member_, member_offset_;
  std::vector<std::int32_t> group_cell_;
  std::vector<std::size_t> group_offset_;
  std::vector<std::uint8_t> lacking_;  ///< (groups)
  std::vector<std::int32_t> edge_, lack_;
  std::vector<std::size_t> edge_offset_, lack_offset_;  ///< (groups + 1), (candidates)
  std::vector<std::int32_t> lack_count_;                ///< (candidates)
  std::vector<std::uint8_t> seen_, seen_packed_;
  int seen_cells_ = 0;
  std::vector<std::int32_t> taken_;
  std::vector<Entry> entries_, changed_, merged_;  ///< sorted by hash, then candidate
  std::vector<std::uint8_t> first_of_kind_;        ///< (candidates)
  std::vector<int> next_of_group_;                 ///< (groups)
  Distinct distinct_;
};

}  // namespace lightrig
