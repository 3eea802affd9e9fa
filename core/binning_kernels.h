#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "core/light.h"

namespace lightrig {

/// Points as one array per coordinate: what binning's inner loops run over.
struct PointColumns {
  std::vector<std::int32_t> index;  ///< of the point in SurfacePoints
  std::vector<double> px, py, pz;   ///< [m]
  std::vector<double> nx, ny, nz;   ///< unit normal
  std::vector<double> vx, vy, vz;   ///< unit, towards the camera
  std::size_t size() const { return index.size(); }
  Eigen::Vector3d position(std::size_t i) const { return {px[i], py[i], pz[i]}; }
  Eigen::Vector3d normal(std::size_t i) const { return {nx[i], ny[i], nz[i]}; }

  /// Lengthens the coordinates by a vector of eight, so that loops may run past the last point.
  void pad();
};

/// Marks in `chord2` of points that show nothing.
inline constexpr double unlit = -1;           ///< n·l ≤ 0 or beyond a limit
inline constexpr double no_half_vector = -2;  ///< l = −v

/// 4 sin²(θh/2) and tan²θd of points first … first + chord2.size() − 1 under one light; chord2 is
/// negative where a point shows nothing. The same operations in the same order as half_diff(). Both
/// are written in whole vectors of eight: their memory reaches to the next multiple. Padded points.
void angles_of_points(const PointColumns& points, std::size_t first, const LightPosition& light,
                      double min_cos_i, double max_tangent2, std::span<double> chord2,
                      std::span<double> tangent2, int level);

/// Points whose normals lie within `radius` (a chord) of a unit vector.
struct NormalBundles {
  std::vector<double> x, y, z, radius;
  std::vector<std::int32_t> first;  ///< (bundles + 1): ranges of a PointColumns in bundle order
  std::size_t size() const { return x.size(); }
};

/// What one distant light can show on each bundle: the greatest n·l, and the range of 4 sin²(θh/2)
/// about the half vector h, all with room for rounding.
void bundle_ranges(const NormalBundles& bundles, const Eigen::Vector3d& l, const Eigen::Vector3d& h,
                   std::span<double> greatest_cosine, std::span<double> least_chord2,
                   std::span<double> greatest_chord2, int level);

/// Sorts points into bundles of about `size` by their normals. Before padding.
NormalBundles bundle_normals(PointColumns& points, int size);

}  // namespace lightrig
