#pragma once

#include "core/mesh.h"

namespace lightrig {

/// Built-in objects, centred on the origin, vertex normals those of the exact surface. `fineness`
/// ≥ 1 multiplies the tessellation; vertices lie on the exact surface, so that areas and volumes
/// tend to its own from below as 1/fineness².
Mesh make_sphere(double radius, int fineness);               ///< [m]; geodesic, 5,120·fineness²
                                                             ///< triangles
Mesh make_plane(double width, double height, int fineness);  ///< [m]; along x and y at z = 0,
                                                             ///< normal +z
Mesh make_cylinder(double radius, double height, int fineness);  ///< [m]; axis z, capped, with a
                                                                 ///< sharp rim
Mesh make_torus(double major, double minor, int fineness);       ///< [m]; axis z, major > minor
/// Newell's 1975 teapot from its 32 published bicubic patches [Newell 1975; Crow 1987], z up, the
/// spout towards +x, scaled to `height` [m]. Handle and spout end inside the body, and lid and rim
/// do not meet: the mesh has boundary edges, as the published model does.
Mesh make_teapot(double height, int fineness);

/// The teapot in the units of its patches, each divided into segments² quads. make_teapot() uses 10
/// segments at fineness 1.
Mesh tessellate_teapot(int segments);

}  // namespace lightrig
