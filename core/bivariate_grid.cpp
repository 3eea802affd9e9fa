#include "core/bivariate_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lightrig {

namespace {

constexpr double half_pi = std::numbers::pi / 2;

/// ⌊x⌋ brought into 0 … n − 1; NaN, which no geometry yields, counts as 0.
int clamped_index(double x, int n) {
  if (!(x > 0.0)) return 0;
  return x >= n ? n - 1 : static_cast<int>(x);
}

}  // namespace

int row_of_theta_h(const BivariateGrid& grid, double theta_h) {
  return clamped_index(grid.n_h * std::sqrt(std::max(0.0, theta_h) / half_pi), grid.n_h);
}

int column_of_theta_d(const BivariateGrid& grid, double theta_d) {
  return clamped_index(grid.n_d * (theta_d / half_pi), grid.n_d);
}

int cell_of(const BivariateGrid& grid, const HalfDiff& angles) {
  return grid.cell(row_of_theta_h(grid, angles.theta_h), column_of_theta_d(grid, angles.theta_d));
}

HalfDiff cell_centre(const BivariateGrid& grid, int cell) {
  const double warped = (grid.row_h(cell) + 0.5) / grid.n_h;
  return {half_pi * warped * warped, half_pi * (grid.column_d(cell) + 0.5) / grid.n_d, half_pi};
}

bool reachable(const BivariateGrid& grid, int cell) {
  // cos θi and cos θo are cos θh cos θd ∓ sin θh sin θd cos φd: both at once are greatest at φd =
  // π/2.
  const HalfDiff centre = cell_centre(grid, cell);
  return std::cos(centre.theta_h) * std::cos(centre.theta_d) > 0.0;
}

}  // namespace lightrig
