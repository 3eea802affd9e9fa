#include "core/footprint.h"

#include <cmath>
#include <numbers>

#include "core/azimuth_model.h"
#include "core/half_diff.h"

namespace lightrig {

Footprint footprint_of(const SurfacePoints& points, Eigen::Index i,
                       const PixelNeighbours* neighbours, const CameraModel& camera,
                       const LightPosition& light, const BivariateGrid& grid) {
  constexpr double half_pi = std::numbers::pi / 2;
  const Eigen::Vector3d x = points.position.col(i), n = points.normal.col(i);
  Footprint out;
  const HalfDiff centre = half_diff(n, light.direction_from(x), points.view.col(i));
  out.azimuth = static_cast<float>(azimuth_share(centre));
  const auto put = [&](std::size_t k, const HalfDiff& angles) {
    out.h[k] = static_cast<float>(grid.n_h * std::sqrt(angles.theta_h / half_pi));
    out.d[k] = static_cast<float>(grid.n_d * angles.theta_d / half_pi);
  };
  if (neighbours == nullptr || !neighbours->whole(i)) {
    for (std::size_t k = 0; k < 4; ++k) put(k, centre);
    return out;
  }
  const PixelNeighbours::Slopes slope = neighbours->slopes(i);
  for (std::size_t k = 0; k < 4; ++k) {
    // Middles of the pixel's quarters.
    const double u = (k & 1U) != 0 ? 0.25 : -0.25, v = (k & 2U) != 0 ? 0.25 : -0.25;
    const Eigen::Vector3d at = x + u * slope.position_u + v * slope.position_v;
    const Eigen::Vector3d normal = (n + u * slope.normal_u + v * slope.normal_v).normalized();
    put(k, half_diff(normal, light.direction_from(at), view_direction(camera, at)));
  }
  return out;
}

}  // namespace lightrig
