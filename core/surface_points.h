#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/camera_model.h"
#include "core/mesh.h"
#include "core/occlusion.h"

namespace lightrig {

/// Surface points that the camera sees, with what the angles need.
struct SurfacePoints {
  Eigen::Matrix3Xd position;  ///< (3 × n) [m, world]
  Eigen::Matrix3Xd normal;    ///< (3 × n), unit, interpolated
  Eigen::Matrix3Xd view;      ///< (3 × n), unit, towards the camera
  std::vector<int> source;    ///< pixel index (row · width + column) or vertex index
  bool from_pixels = false;

  Eigen::Index size() const { return position.cols(); }
};

/// One point per camera pixel whose ray meets the mesh, on every `stride`-th row and column;
/// normals interpolated. Points whose interpolated normal turns away from the camera are dropped.
SurfacePoints points_of_pixels(const Mesh& mesh, const Occluder& occluder,
                               const CameraModel& camera, int stride);

/// The mesh vertices that face the camera, project into the image and are not hidden from the
/// camera.
SurfacePoints points_of_vertices(const Mesh& mesh, const Occluder& occluder,
                                 const CameraModel& camera);

/// The mesh vertices that face the camera and project into the image, hidden ones included: what
/// points_of_vertices() begins with, and all it does on a convex object.
SurfacePoints facing_vertices(const Mesh& mesh, const CameraModel& camera);

}  // namespace lightrig
