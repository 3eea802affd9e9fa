#pragma once

#include <Eigen/Core>
#include <bit>
#include <cstdint>
#include <vector>

#include "core/bivariate_grid.h"

namespace lightrig {

/// Finds i with boundary[i − 1] ≤ x < boundary[i] for x ≥ 0 by one table look-up and one
/// comparison: a bucket is a range of leading bits of x, so narrow that it holds one boundary at
/// most.
class BoundarySearch {
 public:
  /// `boundary` strictly ascending, positive and finite.
  explicit BoundarySearch(const std::vector<double>& boundary);

  /// Boundaries at or below x.
  int operator()(double x) const {
    const std::int64_t bucket = (std::bit_cast<std::int64_t>(x) >> shift_) - first_;
    if (bucket < 0) return 0;
    if (bucket >= static_cast<std::int64_t>(below_.size())) return count_;
    const auto i = static_cast<std::size_t>(bucket);
    return below_[i] + (x >= split_[i] ? 1 : 0);
  }

 private:
  int shift_ = 0;
  std::int64_t first_ = 0;
  int count_ = 0;
  std::vector<double> split_;        ///< the boundary within a bucket, or infinity
  std::vector<std::int32_t> below_;  ///< boundaries below the bucket
};

/// cell_of(grid, half_diff(n, wi, wo)) without angles: the chords are compared with the grid's
/// lines. Equal to it bit for bit: each line is the least double that cell_of() sends across.
class CellLookup {
 public:
  explicit CellLookup(const BivariateGrid& grid);

  /// n, wi, wo unit vectors, wi ≠ −wo.
  int operator()(const Eigen::Vector3d& n, const Eigen::Vector3d& wi,
                 const Eigen::Vector3d& wo) const;

  /// Row of 4 sin²(θh/2), column of tan²θd.
  int row(double half_chord2) const { return row_(half_chord2); }
  int column(double difference_tangent2) const { return column_(difference_tangent2); }
  const BivariateGrid& grid() const { return grid_; }

  /// The least 4 sin²(θh/2) of a row, 0 … n_h: row(x) ≥ i exactly where x ≥ row_begin(i).
  double row_begin(int i) const { return row_begin_[static_cast<std::size_t>(i)]; }

 private:
  BivariateGrid grid_;
  std::vector<double> row_begin_;
  BoundarySearch row_, column_;
};

}  // namespace lightrig
