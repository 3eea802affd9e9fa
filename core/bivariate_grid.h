#pragma once

#include <Eigen/Core>

#include "core/half_diff.h"

namespace lightrig {

/// The (θh, θd) grid of MERL without its third angle [Romeiro 2008]; θh square-root warped, θd
/// uniform. Cell index = i_h · n_d + i_d.
struct BivariateGrid {
  int n_h = 90;
  int n_d = 90;

  int cells() const { return n_h * n_d; }
  int cell(int i_h, int i_d) const { return i_h * n_d + i_d; }
  int row_h(int cell_index) const { return cell_index / n_d; }
  int column_d(int cell_index) const { return cell_index % n_d; }
  bool operator==(const BivariateGrid&) const = default;
};

/// Cell that holds these angles; MERL's convention: i_h = ⌊n_h √(2θh/π)⌋, i_d = ⌊n_d 2θd/π⌋,
/// clamped to the grid.
int cell_of(const BivariateGrid& grid, const HalfDiff& angles);

/// The two indices by themselves; both never decrease with their angle [rad].
int row_of_theta_h(const BivariateGrid& grid, double theta_h);
int column_of_theta_d(const BivariateGrid& grid, double theta_d);

/// Angles at the centre of a cell (centre in the warped coordinate), φd = π/2.
HalfDiff cell_centre(const BivariateGrid& grid, int cell);

/// Whether any pair of directions above the horizon falls on the cell's centre for some φd.
bool reachable(const BivariateGrid& grid, int cell);

}  // namespace lightrig
