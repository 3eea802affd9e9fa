#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>

namespace lightrig {

/// Geometry of the camera: a pinhole with OpenCV's distortion, or a parallel (distant) view.
struct CameraModel {
  enum class Projection : std::uint8_t { perspective, orthographic };
  Projection projection = Projection::perspective;
  int width = 0, height = 0;  ///< [px]
  double fx = 0, fy = 0;      ///< perspective: focal lengths [px]; orthographic: scale [px/m]
  double cx = 0, cy = 0;      ///< principal point [px]; pixel (i, j) has its centre at (i, j)
  std::array<double, 5> distortion{};  ///< k1 k2 p1 p2 k3 (OpenCV); all zero for none
  Eigen::Isometry3d camera_from_world =
      Eigen::Isometry3d::Identity();  ///< +z forward, +x right, +y down
};

struct Ray {
  Eigen::Vector3d origin;     ///< [m]
  Eigen::Vector3d direction;  ///< unit
};

/// The ray of sight through pixel coordinates (u, v) [px] in the world frame.
Ray ray_through(const CameraModel& camera, double u, double v);

/// Pixel coordinates [px] of a world point; behind a perspective camera: NaN.
Eigen::Vector2d project(const CameraModel& camera, const Eigen::Vector3d& p_in_world);

/// Unit vector from a world point towards the camera.
Eigen::Vector3d view_direction(const CameraModel& camera, const Eigen::Vector3d& p_in_world);

/// True for a parallel view, where view_direction is the same everywhere.
inline bool distant(const CameraModel& camera) {
  return camera.projection == CameraModel::Projection::orthographic;
}

/// A camera at `eye` looking at `target` with `up` upwards in the image.
Eigen::Isometry3d look_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
                          const Eigen::Vector3d& up);

}  // namespace lightrig
