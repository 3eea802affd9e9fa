#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/bivariate_grid.h"
#include "core/light.h"
#include "core/occlusion.h"
#include "core/surface_points.h"

namespace lightrig {

/// Geometry too oblique to measure well is masked, in planning and in extraction alike.
struct GrazingLimits {
  double max_theta_d = 1.3962634015954636;  ///< [rad]; 80°
  double min_cos_i = 0.17364817766693041;   ///< cos 80°
  double min_cos_o = 0.17364817766693041;   ///< cos 80°
};
inline constexpr GrazingLimits no_grazing_limits{1.5707963267948966, 0.0, 0.0};

/// The grid cells each candidate light shows to the camera, sorted and unique, in compressed rows.
struct CandidateBins {
  BivariateGrid grid;
  std::vector<std::int64_t> offset;  ///< (candidates + 1)
  std::vector<std::int32_t> cell;    ///< (offset.back())

  int candidates() const { return static_cast<int>(offset.size()) - 1; }
  std::span<const std::int32_t> of(int candidate) const {
    const auto i = static_cast<std::size_t>(candidate);
    return {cell.data() + offset[i], cell.data() + offset[i + 1]};
  }
};

enum class ShadowRays : std::uint8_t {
  none,    ///< ignore shadows
  needed,  ///< the least rays that give the same bins as `all`
  all,     ///< one per lit point: the plain reference
};

/// What binning left out, and did: each pair of a candidate and a point is counted once, as tested,
/// back-facing, without half vector or passed over. Of those tested, each has its shadow ray cast
/// or left out; each filled a cell, was found in shadow, or is a repeated one.
struct BinningStatistics {
  std::int64_t points_tested =
      0;                         ///< candidate × point pairs that face the light within the limits
  std::int64_t back_facing = 0;  ///< pairs dropped: n·l ≤ 0, beyond the grazing limits or the
                                 ///< lamp's lobe
  std::int64_t no_half_vector = 0;  ///< pairs with l = −v
  std::int64_t repeated = 0;     ///< tested pairs that no cell needed: it was filled by another, or
                                 ///< has no statistics
  std::int64_t in_shadow = 0;    ///< tested pairs whose ray was blocked
  std::int64_t passed_over = 0;  ///< pairs never looked at: their whole bundle of normals is unlit
                                 ///< or shows nothing new (distant lamp and view)
  std::int64_t rays_cast = 0;
  std::int64_t rays_left_out = 0;  ///< pairs that needed no shadow ray
  bool convex = false;             ///< the object was found convex and no ray needed at all

  /// Adds another's counts.
  void add(const BinningStatistics& part);
};

struct BinningResult {
  CandidateBins bins;
  BinningStatistics statistics;
};

/// Bins of every candidate over the points: lit, camera-facing, within the limits, unshadowed.
/// `valid` (cells) masks cells without statistics; empty means all. Uses `threads` threads; the
/// result does not depend on their number.
BinningResult bin_candidates(const SurfacePoints& points, std::span<const LightPosition> candidates,
                             const BivariateGrid& grid, std::span<const std::uint8_t> valid,
                             const GrazingLimits& limits, const Occluder& occluder, ShadowRays rays,
                             int threads);

}  // namespace lightrig
