#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/binning_kernels.h"
#include "core/candidate_bins.h"
#include "core/cell_lookup.h"
#include "core/planner_kernels.h"

namespace lightrig {

/// What binning has in common over all candidates.
struct BinningSetting {
  const SurfacePoints& points;
  std::span<const std::uint8_t> valid;
  CellLookup lookup;
  GrazingLimits limits;
  double max_tangent2;  ///< tan² of limits.max_theta_d
  const Occluder& occluder;
  ShadowRays rays;
  PointColumns in_view;   ///< points within the camera's grazing limit
  NormalBundles bundles;  ///< of in_view, where the view is the same everywhere; else empty
  PointColumns sample;    ///< some of in_view, bundle after bundle; normals only
  std::vector<std::int32_t> sample_of_bundle;  ///< (bundles + 1): ranges of the sample
  std::vector<double>
      horizon;                 ///< (sample) with shadow rays: a lit point above it is not in shadow
  bool one_view = false;       ///< every point is seen from one direction
  Eigen::Vector3d view;        ///< that direction
  int level = vector_level();  ///< of the processor
  double sure_cosine = 2;      ///< no point with a greater n·l is in shadow (convex objects)

  /// Whether a lit point may be in shadow, or every one is to be asked.
  bool casts_rays() const {
    return rays == ShadowRays::all ||
           (rays == ShadowRays::needed && !(limits.min_cos_i >= sure_cosine));
  }
  /// Whether a lit point cannot be in shadow.
  bool is_sure(const LightPosition& light, std::int32_t point) const {
    if (sure_cosine > 1 || rays != ShadowRays::needed) return false;
    const Eigen::Vector3d l = light.direction_from(points.position.col(point));
    return points.normal.col(point).dot(l) > sure_cosine;
  }
  bool has_statistics(std::int32_t cell) const {
    return valid.empty() || valid[static_cast<std::size_t>(cell)] != 0;
  }
};

/// A lit, camera-facing point and the cell that one light shows there.
struct BinnedPoint {
  std::int32_t point, cell;
};

/// Rows looked for, as what they hold of 4 sin²(θh/2): low ≤ x < high.
struct RowInterval {
  double low, high;
};

/// Memory that one worker uses again for every candidate.
struct BinningScratch {
  std::vector<BinnedPoint> lit;
  /// (cells, or rows where the light shows one column), all zero between candidates
  std::vector<std::uint8_t> filled;
  std::vector<std::int32_t> start;   ///< (cells + 1)
  std::vector<std::int32_t> sorted;  ///< lit points by cell
  std::vector<std::int32_t> open;    ///< cells that still look for an unblocked point
  std::vector<std::int32_t> next, point;
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::uint8_t> blocked;
  std::array<double, 1024> chord2, tangent2;
  std::vector<std::int32_t> cell_of_point;  ///< (points in view), −1: shows none
  std::vector<std::int32_t> tried;          ///< (cells)

  std::vector<double> cosine, least, greatest;  ///< (bundles)
  std::vector<double> may;                      ///< (bundles): open intervals that it may show
  std::vector<std::int32_t> bundle;             ///< the first `bundles`: those to walk
  std::size_t bundles = 0;
  std::vector<double> chords;           ///< of the points looked at together
  std::vector<double> sample_chords;    ///< of the sample
  std::vector<std::int32_t> hit;        ///< those of them within the rows looked for
  std::vector<std::uint8_t> open_rows;  ///< (rows + 8): 1 = has statistics and is looked for
  std::vector<std::uint8_t> shown;      ///< (rows + 8): 1 = a point was found
  std::vector<RowInterval> intervals;   ///< of 4 sin²(θh/2), that hold the open rows
};

/// The rows that a distant light fills where every point is seen from one direction, in
/// scratch.filled by row. Returns their column.
int fill_one_column(const BinningSetting& setting, const LightPosition& light,
                    BinningScratch& scratch, BinningStatistics& statistics);

}  // namespace lightrig
