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

/// What repaired() changed, for the message that says so.
struct MeshRepairs {
  int non_finite_vertices = 0;       ///< dropped, with their triangles
  int duplicate_vertices = 0;        ///< merged
  int degenerate_triangles = 0;      ///< no area, or an index that names no vertex: dropped
  int duplicate_triangles = 0;       ///< dropped
  int unused_vertices = 0;           ///< dropped
  int rewound_triangles = 0;         ///< wound against their neighbours: reversed
  bool flipped_orientation = false;  ///< a part was inside-out (negative volume): reversed
  bool computed_normals = false;     ///< none given, or unusable: angle-weighted vertex normals
  int turned_normals = 0;            ///< given, but pointing to the inner side: reversed
  int non_manifold_edges = 0;        ///< shared by more than two triangles: left, said
  int boundary_edges = 0;            ///< of one triangle: left, said
  int components = 0;                ///< parts that share no vertex position
};

}  // namespace lightrig
