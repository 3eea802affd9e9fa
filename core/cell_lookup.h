#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
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

  /// Boundaries at or below x. Without branches: what lies below the first bucket or beyond the
  /// last one is told apart by the boundaries that these two hold.
  int operator()(double x) const {
    const std::int64_t bucket = (std::bit_cast<std::int64_t>(x) >> shift_) - first_;
    const Bucket& at =
        bucket_[static_cast<std::size_t>(std::clamp(bucket, std::int64_t{0}, last_bucket_))];
    return at.below + (x >= at.split ? 1 : 0);
  }

 private:
  struct Bucket {
    double split = std::numeric_limits<double>::infinity();  ///< the boundary within, if any
    std::int32_t below = 0;                                  ///< boundaries below the bucket
  };

  int shift_ = 0;
  std::int64_t first_ = 0, last_bucket_ = 0;
  std::vector<Bucket> bucket_;
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
  /// The same of a column's tan²θd.
  double column_begin(int i) const { return column_begin_[static_cast<std::size_t>(i)]; }

 private:
  BivariateGrid grid_;
  std::vector<double> row_begin_, column_begin_;
  BoundarySearch row_, column_;
};

}  // namespace lightrig
