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
/// acos, and keep full precision.
HalfDiff half_diff(const Eigen::Vector3d& n, const Eigen::Vector3d& wi, const Eigen::Vector3d& wo);

/// The configuration with these angles whose half vector has azimuth 0. wi or wo may lie below the
/// horizon (z < 0).
DirectionPair directions(const HalfDiff& angles);

}  // namespace lightrig
