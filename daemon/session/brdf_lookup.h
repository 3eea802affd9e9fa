#pragma once

#include <Eigen/Core>

#include "core/brdf_table.h"

namespace lightrig {

/// A BRDF table read between its cells, for pictures and predicted images: bilinear in (√θh, θd) on
/// ln f, which keeps a highlight's shape; cells without a value take the nearest one of their θd
/// column.
class BrdfLookup {
 public:
  /// Errors: none; a table without any valid value reads as 0.
  explicit BrdfLookup(const BrdfTable& table);

  int channels() const { return static_cast<int>(ln_f_.rows()); }
  const BivariateGrid& grid() const { return grid_; }

  /// f [1/sr] of one channel.
  double operator()(double theta_h, double theta_d, int channel) const;

  /// f [1/sr] of a channel in a cell, holes filled.
  double at(int cell, int channel) const;

 private:
  BivariateGrid grid_;
  Eigen::ArrayXXf ln_f_;  ///< (C × cells)
};

}  // namespace lightrig
