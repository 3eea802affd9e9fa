#include "core/surface_points.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "core/check.h"

namespace lightrig {

namespace {

/// Points found one after another, before their number is known.
struct Gathered {
  std::vector<Eigen::Vector3d> position, normal, view;
  std::vector<int> source;

  void add(const Eigen::Vector3d& p, const Eigen::Vector3d& n, const Eigen::Vector3d& v, int from) {
    position.push_back(p);
    normal.push_back(n);
    view.push_back(v);
    source.push_back(from);
  }
};

SurfacePoints packed(Gathered gathered, bool from_pixels) {
  SurfacePoints points;
  const auto n = static_cast<Eigen::Index>(gathered.source.size());
  points.position.resize(3, n);
  points.normal.resize(3, n);
  points.view.resize(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    points.position.col(i) = gathered.position[k];
    points.normal.col(i) = gathered.normal[k];
    points.view.col(i) = gathered.view[k];
  }
  points.source = std::move(gathered.source);
  points.from_pixels = from_pixels;
  return points;
}

/// The camera as a light: what it sees is what it would light.
LightPosition camera_as_light(const CameraModel& camera) {
  LightPosition light;
  light.distant = distant(camera);
  const Eigen::Isometry3d world_from_camera = camera.camera_from_world.inverse();
  light.p = light.distant ? Eigen::Vector3d(-world_from_camera.linear().col(2).normalized())
                          : Eigen::Vector3d(world_from_camera.translation());
  return light;
}

Gathered facing_the_camera(const Mesh& mesh, const CameraModel& camera) {
  Gathered facing;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Eigen::Vector3d p = mesh.vertices.col(i);
    const Eigen::Vector3d view = view_direction(camera, p);
    const Eigen::Vector3d normal = mesh.normals.col(i);
    if (!(normal.dot(view) > 0)) continue;
    const Eigen::Vector2d pixel = project(camera, p);
    // Pixel (i, j) covers ±½ about its centre; a point behind the camera projects to NaN.
    if (!(pixel.x() >= -0.5 && pixel.x() < camera.width - 0.5 && pixel.y() >= -0.5 &&
          pixel.y() < camera.height - 0.5)) {
      continue;
    }
    facing.add(p, normal, view, static_cast<int>(i));
  }
  return facing;
}

}  // namespace

SurfacePoints points_of_pixels(const Mesh& mesh, const Occluder& occluder,
                               const CameraModel& camera, int stride) {
  CHECK(stride >= 1);
  Gathered gathered;
  for (int row = 0; row < camera.height; row += stride) {
    for (int column = 0; column < camera.width; column += stride) {
      const Ray ray = ray_through(camera, column, row);
      const std::optional<Hit> hit = occluder.first_hit(ray);
      if (!hit) continue;
      const Eigen::Vector3i corner = mesh.triangles.col(hit->triangle);
      const double w = 1.0 - hit->u - hit->v;
      const Eigen::Vector3d p = w * mesh.vertices.col(corner[0]) +
                                hit->u * mesh.vertices.col(corner[1]) +
                                hit->v * mesh.vertices.col(corner[2]);
      const Eigen::Vector3d blend = w * mesh.normals.col(corner[0]) +
                                    hit->u * mesh.normals.col(corner[1]) +
                                    hit->v * mesh.normals.col(corner[2]);
      const double length = blend.norm();
      if (!(length > 1e-6)) continue;  // normals that cancel say nothing
      const Eigen::Vector3d normal = blend / length;
      const Eigen::Vector3d view = -ray.direction;
      if (!(normal.dot(view) > 0)) continue;
      gathered.add(p, normal, view, row * camera.width + column);
    }
  }
  return packed(std::move(gathered), true);
}

SurfacePoints facing_vertices(const Mesh& mesh, const CameraModel& camera) {
  return packed(facing_the_camera(mesh, camera), false);
}

SurfacePoints points_of_vertices(const Mesh& mesh, const Occluder& occluder,
                                 const CameraModel& camera) {
  Gathered facing = facing_the_camera(mesh, camera);
  // Every vertex that faces the camera is above the rest of the body.
  if (occluder.sure_cosine(true) == 0) return packed(std::move(facing), false);
  std::vector<std::uint8_t> hidden(facing.source.size());
  occluder.blocked(facing.position, facing.normal, camera_as_light(camera), hidden);
  Gathered seen;
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    if (hidden[i] != 0) continue;
    seen.add(facing.position[i], facing.normal[i], facing.view[i], facing.source[i]);
  }
  return packed(std::move(seen), false);
}

}  // namespace lightrig
