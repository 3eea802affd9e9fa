#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "core/camera_model.h"
#include "core/light.h"
#include "core/mesh.h"

namespace lightrig {

/// Where a ray meets the mesh.
struct Hit {
  double distance = 0;  ///< [m]
  int triangle = -1;
  double u = 0, v = 0;  ///< barycentric coordinates of vertices 1 and 2
};

/// Answers "what does this ray meet" for one mesh; the only owner of Embree. Immutable once built;
/// safe to share between threads for queries. Works in units of the mesh's own size, so 1e-4 m and
/// 1e3 m objects behave alike.
class Occluder {
 public:
  explicit Occluder(const Mesh& mesh);
  ~Occluder();
  Occluder(Occluder&&) noexcept;
  Occluder& operator=(Occluder&&) noexcept;

  std::optional<Hit> first_hit(const Ray& ray) const;

  /// Whether the segment from a surface point towards the light is blocked. The start is moved off
  /// the surface along the normal by a small fraction of the mesh's size, so that a point does not
  /// shade itself.
  bool blocked(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
               const LightPosition& light) const;

  /// blocked() for many points, one ray after another; writes 1 where blocked.
  void blocked(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector3d> normals,
               const LightPosition& light, std::span<std::uint8_t> out) const;

  /// How high the mesh rises about a surface point: where n·l is greater, l the unit vector from
  /// where the point's shadow rays start to the light, blocked() is false without asking. 0 … 1,
  /// and more where no direction is sure.
  double horizon(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const;

  /// True when the mesh is closed and convex: what it stands for shades nothing of itself. Its flat
  /// faces may, where a blended normal faces a lamp that the face is turned away from.
  bool convex() const;

  /// The same for all points whose normals are the mesh's: where n·l is greater, blocked() is false
  /// without asking. With `at_vertices` for the vertices alone, with their own normals; else for
  /// all points, with normals blended of a face's corners. 0 where no normal leans further than the
  /// body allows; above 1 where nothing is sure or the mesh not convex.
  double sure_cosine(bool at_vertices) const;

 private:
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

}  // namespace lightrig
