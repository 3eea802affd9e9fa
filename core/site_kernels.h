#pragma once

#include <cstddef>

#include "core/light.h"

namespace lightrig {

/// Geometry of a run of points under one light, one array per quantity.
struct SiteAngles {
  static constexpr std::size_t size = 512;
  /// In place of chord2: cos θi or cos θo is 0 or less, or l = −v, which has no half vector; or it
  /// is lit, beyond the limits.
  static constexpr double unlit = -2, grazing = -1;

  alignas(64) double cos_i[size];
  alignas(64) double cos_o[size];
  alignas(64) double sum2[size];         ///< |l + v|²; near 0 there is no half vector
  alignas(64) double difference2[size];  ///< |l − v|²
  alignas(64) double tangent2[size];  ///< tan²θd, the ratio of the two; no number where both are 0
  alignas(64) double chord2[size];    ///< 4 sin²(θh/2), or why there is none
  alignas(64) double irradiance[size];  ///< falloff · cos θi, per unit of lamp strength
};

/// Lit well enough: cos θi and cos θo at least these, tan²θd at most this.
struct SiteLimits {
  double min_cos_i = 0, min_cos_o = 0, max_tangent2 = 0;
};

/// Fills the first `count` ≤ size entries from points whose coordinates stand three by three, as
/// the columns of SurfacePoints do. The same operations in the same order as half_diff(), on any
/// `level` of processor (vector_level()).
void angles_of_sites(const double* position, const double* normal, const double* view,
                     std::size_t count, const LightPosition& light, const SiteLimits& limits,
                     SiteAngles& out, int level);

}  // namespace lightrig
