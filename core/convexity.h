#pragma once

#include "core/mesh.h"

namespace lightrig {

/// Whether the mesh bounds one convex body: every edge is shared by exactly two triangles that run
/// along it in opposite directions, no edge is concave, and the Euler characteristic is that of a
/// sphere. (A closed surface that is locally convex everywhere and a topological sphere is the
/// boundary of a convex body [van Heijenoort 1952].) `radius` of its bounding sphere, [m].
bool is_closed_and_convex(const Mesh& mesh, double radius);

/// How far normals of a convex body lean from those of planes that have all of it on one side: the
/// greatest sine of the angle between the two, 1 where it is 84° or more. Light from an elevation
/// above that reaches a point whatever its face.
struct NormalTilt {
  double at_vertices = 0;  ///< 0 where each vertex's plane itself has all of the body below it
  double on_faces = 0;     ///< of every normal blended of the corners of a face
};
NormalTilt tilt_of_normals(const Mesh& mesh);

}  // namespace lightrig
