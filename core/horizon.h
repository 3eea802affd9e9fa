#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace lightrig {

/// How high a mesh rises about a place: what lies above that needs no shadow ray. Vertices are kept
/// in clusters, clusters in bigger ones, each in a sphere.
class HorizonTree {
 public:
  HorizonTree() = default;
  /// `vertices` (3 × n), indexed by `triangles` (3 × m).
  HorizonTree(const Eigen::Matrix3Xd& vertices, const Eigen::Matrix3Xi& triangles);

  /// An upper bound of the sine of the elevation, above the plane through `eye` with unit normal n,
  /// of every point of the mesh, not much too high; 1 where it may be anything. A ray from the eye
  /// with a greater n·direction meets nothing.
  double sine(const Eigen::Vector3d& eye, const Eigen::Vector3d& n) const;

 private:
  /// Spheres about vertices, or about spheres of vertices; the longest edge that leaves one of
  /// these vertices, squared.
  struct Spheres {
    std::vector<double> x, y, z, radius, edge2;
    std::size_t size() const { return x.size(); }
    void add(const Eigen::Vector3d& centre, double sphere_radius, double longest_edge2);
  };
  struct Eye;

  void take_triangles(const Eigen::Matrix3Xi& triangles, std::span<const std::int32_t> place);
  void build_spheres();
  double look(const Eye& from, const Eigen::Vector3d& eye, const Eigen::Vector3d& n) const;
  double of_triangles_at(std::size_t vertex, const Eigen::Vector3d& eye,
                         const Eigen::Vector3d& n) const;

  /// A triangle at a vertex: the other two.
  struct Corner {
    std::int32_t next, last;
  };

  Eigen::Matrix3Xd vertices_;               ///< what is near stays together
  Spheres points_;                          ///< the same, radius 0, to whole groups
  Spheres clusters_, groups_;               ///< of 32 vertices, of 8 clusters
  Spheres middles_;                         ///< a vertex of each group
  std::vector<Corner> corner_;              ///< of all vertices, one vertex after another
  std::vector<std::int32_t> first_corner_;  ///< (points + 1)
  int level_ = 2;                           ///< of the processor
};

}  // namespace lightrig
