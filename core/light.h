#pragma once

#include <Eigen/Core>

namespace lightrig {

/// Where the lamp is, as the surface sees it: a point at a distance, or a distant lamp by direction
/// alone.
struct LightPosition {
  bool distant = false;
  Eigen::Vector3d p =
      Eigen::Vector3d::UnitZ();  ///< near: position [m, world]; distant: unit direction towards it

  /// Unit vector from x [m] to the light.
  Eigen::Vector3d direction_from(const Eigen::Vector3d& x) const {
    return distant ? p : Eigen::Vector3d((p - x).normalized());
  }
  /// Irradiance on a surface facing the light per unit of lamp strength: 1/r² [1/m²] near (strength
  /// in W/sr), 1 distant (strength in W/m²).
  double falloff(const Eigen::Vector3d& x) const {
    return distant ? 1.0 : 1.0 / (p - x).squaredNorm();
  }
};

}  // namespace lightrig
