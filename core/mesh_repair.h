#pragma once

#include "core/mesh.h"

namespace lightrig {

struct RepairedMesh {
  Mesh mesh;
  MeshRepairs repairs;
};

/// A mesh as the planner and the renderer need it: finite, without doubles, wound and with normals
/// pointing outwards. `mesh.normals` may be empty (or of another size than the vertices): then
/// every vertex gets the mean of its triangles' normals, weighted by their angles there [Thürmer &
/// Wüthrich 1998]. Facet normals, such as STL's, are better left out than passed.
///
/// Vertices are one where their positions (and, if given, normals to within 1°) are equal.
/// Neighbours that disagree are wound alike; then a connected part that is closed is turned if its
/// signed volume is negative, an open one only if its volume about its own centroid is clearly
/// negative: a flat sheet keeps the side its file gave it. Edges with more than two triangles and
/// boundary edges are counted and left. Order is kept. An empty result is the caller's to refuse.
RepairedMesh repaired(const Mesh& mesh);

/// The signed volume that the triangles enclose about `origin` [m³]; independent of it when closed.
double signed_volume(const Mesh& mesh, const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());
double surface_area(const Mesh& mesh);  ///< [m²]

}  // namespace lightrig
