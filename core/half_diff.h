#pragma once

#include <Eigen/Core>

namespace lightrig {

/// Half/difference angles of an isotropic BRDF [Rusinkiewicz 1998].
struct HalfDiff {
  double theta_h = 0;  ///< [rad], 0 … π/2: between normal and half vector.
  double theta_d = 0;  ///< [rad], 0 … π/2: between half vector and either direction.
  double phi_d =
      0;  ///< [rad], 0 … π: azimuth of the light about the half vector; reciprocity folds π … 2π.
};

/// A pair of directions in the surface's own frame, normal = +z; both unit vectors away from the
/// surface.
struct DirectionPair {
  Eigen::Vector3d wi;  ///< towards the light
  Eigen::Vector3d wo;  ///< towards the camera
};

/// Angles of a configuration. n, wi, wo are unit vectors in one frame, wi ≠ −wo (then there is no
/// half vector: callers drop such a pair). Angles near 0 and π/2 are taken from chords, not from
/// acos, and keep full precision. φd is 0 where it has no meaning (θh = 0 or θd = 0).
HalfDiff half_diff(const Eigen::Vector3d& n, const Eigen::Vector3d& wi, const Eigen::Vector3d& wo);

/// The configuration with these angles whose half vector has azimuth 0. wi or wo may lie below the
/// horizon (z < 0).
DirectionPair directions(const HalfDiff& angles);

/// 4 sin²(θh/2) = |n − h|² of a unit half vector h: the square of the chord, which carries θh at
/// full precision down to 0.
inline double half_chord2(double nx, double ny, double nz, double hx, double hy, double hz) {
  const double x = nx - hx, y = ny - hy, z = nz - hz;
  return x * x + y * y + z * z;
}

/// tan²θd = |wi − wo|² / |wi + wo|², which carries θd at full precision near 0 and near π/2.
inline double difference_tangent2(const Eigen::Vector3d& wi, const Eigen::Vector3d& wo) {
  const double x = wi.x() - wo.x(), y = wi.y() - wo.y(), z = wi.z() - wo.z();
  const double a = wi.x() + wo.x(), b = wi.y() + wo.y(), c = wi.z() + wo.z();
  return (x * x + y * y + z * z) / (a * a + b * b + c * c);
}

/// θh [rad] of half_chord2, and θd [rad] of difference_tangent2; both never decrease.
double theta_of_half_chord2(double chord2);
double theta_of_difference_tangent2(double tangent2);

}  // namespace lightrig
