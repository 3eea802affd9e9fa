#pragma once

#include "core/mesh.h"

namespace lightrig {

/// Built-in objects, centred on the origin, outward normals analytic. `fineness` ≥ 1 multiplies the
/// tessellation.
Mesh make_sphere(double radius, int fineness);                   ///< [m]; icosphere
Mesh make_plane(double width, double height, int fineness);      ///< [m]; z = 0, normal +z
Mesh make_cylinder(double radius, double height, int fineness);  ///< [m]; axis z, capped
Mesh make_torus(double major, double minor, int fineness);       ///< [m]; axis z
/// Newell's 1975 teapot from its 32 published bicubic patches [Newell 1975; Crow 1987], z up,
/// scaled to `height` [m].
Mesh make_teapot(double height, int fineness);

}  // namespace lightrig
