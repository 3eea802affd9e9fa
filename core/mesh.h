#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace lightrig {

/// A triangle mesh in the world frame, with unit vertex normals that point outwards.
struct Mesh {
  Eigen::Matrix3Xd vertices;   ///< (3 × n) [m]
  Eigen::Matrix3Xd normals;    ///< (3 × n), unit
  Eigen::Matrix3Xi triangles;  ///< (3 × t) vertex indices, counter-clockwise seen from outside
};

/// What repair() changed, for the message that says so.
struct MeshRepairs {
  int non_finite_vertices = 0;       ///< dropped, with their triangles
  int duplicate_vertices = 0;        ///< merged
  int degenerate_triangles = 0;      ///< zero area or repeated index: dropped
  int duplicate_triangles = 0;       ///< dropped
  int unused_vertices = 0;           ///< dropped
  bool flipped_orientation = false;  ///< was inside-out (negative volume): reversed
  bool computed_normals =
      false;                   ///< none given, or unusable: area- and angle-weighted vertex normals
  int non_manifold_edges = 0;  ///< left as they are, said
  int boundary_edges = 0;      ///< left as they are, said
  int components = 1;
};

}  // namespace lightrig
