#pragma once

#include <cstdint>
#include <vector>

#include "core/candidate_bins.h"
#include "core/half_diff.h"

namespace lightrig::test {

/// Bins by the angles themselves, one shadow ray per lit point whatever the object: no
/// lookup, no batching.
inline std::vector<std::int32_t> bins_by_hand(const SurfacePoints& points,
                                              const LightPosition& light, const BivariateGrid& grid,
                                              const GrazingLimits& limits, const Occluder& occluder,
                                              bool shadows = true) {
  std::vector<std::uint8_t> filled(static_cast<std::size_t>(grid.cells()), 0);
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d n = points.normal.col(i), v = points.view.col(i);
    const Eigen::Vector3d l = light.direction_from(points.position.col(i));
    const double cos_i = n.dot(l), cos_o = n.dot(v);
    if (cos_i <= 0 || cos_i < limits.min_cos_i || cos_o < limits.min_cos_o) continue;
    if ((l + v).norm() == 0) continue;
    const HalfDiff angles = half_diff(n, l, v);
    if (angles.theta_d > limits.max_theta_d) continue;
    if (shadows && occluder.blocked(points.position.col(i), n, light)) continue;
    filled[static_cast<std::size_t>(cell_of(grid, angles))] = 1;
  }
  std::vector<std::int32_t> cells;
  for (std::size_t c = 0; c < filled.size(); ++c) {
    if (filled[c] != 0) cells.push_back(static_cast<std::int32_t>(c));
  }
  return cells;
}

}  // namespace lightrig::test
