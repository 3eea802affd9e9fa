#pragma once

#include <Eigen/Core>
#include <vector>

namespace lightrig {

/// How a lamp's intensity falls off its axis, relative to the intensity along it: cosⁿ of the angle
/// off the axis, or a table; nothing behind the lamp. n = 0 without a table is a lamp that shines
/// alike in every direction, behind it too.
struct EmissionLobe {
  double exponent = 0;            ///< n ≥ 0
  std::vector<double> angle;      ///< [rad] table: increasing, from 0; empty for cosⁿ
  std::vector<double> intensity;  ///< (angle) relative, ≥ 0; linear between, 0 beyond the last

  bool uniform() const { return angle.empty() && exponent == 0; }
  /// Relative intensity at an angle off the axis, given by its cosine.
  double towards(double cos_angle) const;
};

/// Where the lamp is, as the surface sees it: a point at a distance, or a distant lamp by direction
/// alone.
struct LightPosition {
  bool distant = false;
  Eigen::Vector3d p =
      Eigen::Vector3d::UnitZ();  ///< near: position [m, world]; distant: unit direction towards it
  Eigen::Vector3d aim = Eigen::Vector3d::Zero();  ///< unit, where a near lamp's axis points; zero
                                                  ///< with a uniform lobe
  EmissionLobe lobe = {};                         ///< of a near lamp

  /// Below this share of the axis' intensity a point counts as unlit: what is left there depends
  /// on the lobe's rim, which nobody knows well.
  static constexpr double least_emission = 0.02;

  /// Unit vector from x [m] to the light.
  Eigen::Vector3d direction_from(const Eigen::Vector3d& x) const {
    return distant ? p : Eigen::Vector3d((p - x).normalized());
  }
  /// Relative intensity towards x.
  double emission(const Eigen::Vector3d& x) const {
    return distant || lobe.uniform() ? 1.0 : lobe.towards(aim.dot((x - p).normalized()));
  }
  bool reaches(const Eigen::Vector3d& x) const { return emission(x) >= least_emission; }
  /// Irradiance on a surface facing the light per unit of lamp strength: emission/r² [1/m²] near
  /// (strength in W/sr along the axis), 1 distant (strength in W/m²).
  double falloff(const Eigen::Vector3d& x) const {
    return distant ? 1.0 : emission(x) / (p - x).squaredNorm();
  }
};

}  // namespace lightrig
