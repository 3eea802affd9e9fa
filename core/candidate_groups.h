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
  CandidateGroups(const BrdfBasis& basis, const CandidateBins& bins, std::span<const double> scale);

  int candidates() const { return static_cast<int>(count_.size()); }
  int groups() const { return groups_; }
  int group_of(int candidate) const { return group_of_[static_cast<std::size_t>(candidate)]; }
  const PackedRows& rows() const { return rows_; }

  /// Packed cells that a candidate would add, ascending.
  std::span<const std::int32_t> fresh(int candidate) const {
    const auto i = static_cast<std::size_t>(candidate);
    return {fresh_.data() + offset_[i], static_cast<std::size_t>(count_[i])};
  }

  /// Marks a candidate's cells as seen; returns the packed cells that were new.
  std::vector<std::int32_t> take(int candidate);

  const std::vector<std::uint8_t>& seen() const { return seen_; }
  int seen_cells() const { return seen_cells_; }
  bool packed_seen(std::int32_t packed) const {
    return seen_packed_[static_cast<std::size_t>(packed)] != 0;
  }

  /// The open candidates that add a cell, the first of each set that adds the same cells, by group.
  struct Distinct {
    std::vector<std::vector<int>> members;         ///< (groups), ascending
    std::vector<std::vector<std::int32_t>> cells;  ///< (groups): union of what members add
    std::int64_t identical = 0, empty = 0;
  };
  Distinct distinct(const std::vector<std::uint8_t>& open) const;

 private:
  PackedRows rows_;
  std::vector<std::int32_t> grid_cell_;  ///< packed → grid
  std::vector<std::int64_t> offset_;
  std::vector<std::int32_t> fresh_, count_;
  std::vector<int> group_of_;
  int groups_ = 0;
  std::vector<std::uint8_t> seen_, seen_packed_;
  int seen_cells_ = 0;
  const CandidateBins& bins_;
};

}  // namespace lightrig
