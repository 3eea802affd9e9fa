#include "core/convexity.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

namespace lightrig {

namespace {

/// Corners that coincide are one corner: a cube with a normal per face is closed all the same.
/// (vertices) → the first vertex at the same place.
std::vector<int> merged_corners(const Mesh& mesh) {
  std::map<std::array<double, 3>, int> corner_at;
  std::vector<int> corner(static_cast<std::size_t>(mesh.vertices.cols()));
  for (Eigen::Index v = 0; v < mesh.vertices.cols(); ++v) {
    const Eigen::Vector3d p = mesh.vertices.col(v);
    const auto found = corner_at.try_emplace({p.x(), p.y(), p.z()}, static_cast<int>(v)).first;
    corner[static_cast<std::size_t>(v)] = found->second;
  }
  return corner;
}

/// Cosine below which a normal does not belong to its face: 84°.
constexpr double least_cosine = 0.1;

}  // namespace

bool is_closed_and_convex(const Mesh& mesh, double radius) {
  const Eigen::Index triangles = mesh.triangles.cols();
  if (triangles < 4) return false;
  const double slack = 1e-9 * radius;
  // A few faces against all vertices tell most concave objects at once.
  for (Eigen::Index t = 0; t < triangles; t += std::max<Eigen::Index>(1, triangles / 8)) {
    const Eigen::Vector3d a = mesh.vertices.col(mesh.triangles(0, t));
    const Eigen::Vector3d b = mesh.vertices.col(mesh.triangles(1, t));
    const Eigen::Vector3d c = mesh.vertices.col(mesh.triangles(2, t));
    const Eigen::RowVector3d normal = (b - a).cross(c - a).normalized().transpose();
    if ((normal * mesh.vertices).maxCoeff() > normal.dot(a) + 1e-6 * radius) return false;
  }
  struct EdgeUse {
    int forward = 0, backward = 0;
    std::array<int, 2> opposite{-1, -1};
    int triangle = -1;
  };
  const std::vector<int> corner = merged_corners(mesh);
  std::map<std::pair<int, int>, EdgeUse> edges;
  for (Eigen::Index t = 0; t < triangles; ++t) {
    for (int k = 0; k < 3; ++k) {
      const int a = corner[static_cast<std::size_t>(mesh.triangles(k, t))];
      const int b = corner[static_cast<std::size_t>(mesh.triangles((k + 1) % 3, t))];
      const int c = corner[static_cast<std::size_t>(mesh.triangles((k + 2) % 3, t))];
      EdgeUse& use = edges[std::minmax(a, b)];
      int& count = a < b ? use.forward : use.backward;
      ++count;
      use.opposite[a < b ? 0 : 1] = c;
      if (a < b) use.triangle = static_cast<int>(t);
    }
  }
  for (const auto& [ends, use] : edges) {
    if (use.forward != 1 || use.backward != 1) return false;
    const Eigen::Vector3d a = mesh.vertices.col(mesh.triangles(0, use.triangle));
    const Eigen::Vector3d b = mesh.vertices.col(mesh.triangles(1, use.triangle));
    const Eigen::Vector3d c = mesh.vertices.col(mesh.triangles(2, use.triangle));
    const Eigen::Vector3d normal = (b - a).cross(c - a).normalized();
    const Eigen::Vector3d across = mesh.vertices.col(use.opposite[1]);
    if (!(normal.dot(across - a) <= slack)) return false;
  }
  // Convex at every edge still allows several pieces and a surface wound twice about its inside: a
  // sphere has Euler characteristic 2, and both of those do not.
  std::vector<int> used(corner.size(), 0);
  for (Eigen::Index t = 0; t < triangles; ++t) {
    for (int k = 0; k < 3; ++k) {
      used[static_cast<std::size_t>(corner[static_cast<std::size_t>(mesh.triangles(k, t))])] = 1;
    }
  }
  const auto corners = std::accumulate(used.begin(), used.end(), Eigen::Index{0});
  return corners - static_cast<Eigen::Index>(edges.size()) + triangles == 2;
}

NormalTilt tilt_of_normals(const Mesh& mesh) {
  const std::vector<int> corner = merged_corners(mesh);
  const auto n = static_cast<std::size_t>(mesh.vertices.cols());
  std::vector<std::vector<int>> same_place(n);
  for (std::size_t v = 0; v < n; ++v) {
    same_place[static_cast<std::size_t>(corner[v])].push_back(static_cast<int>(v));
  }
  // Of a convex body what is below a plane all around a point is below it everywhere.
  std::vector<std::uint8_t> supports(n, 1);
  std::vector<double> nearest(n, 2.0);  // of the sines to the faces at a vertex
  if (mesh.normals.cols() != mesh.vertices.cols()) return {1, 1};
  NormalTilt tilt;
  for (Eigen::Index t = 0; t < mesh.triangles.cols(); ++t) {
    const Eigen::Matrix3d p = mesh.vertices(Eigen::all, mesh.triangles.col(t));
    const Eigen::Vector3d across = (p.col(1) - p.col(0)).cross(p.col(2) - p.col(0));
    const Eigen::Vector3d face = across.normalized();
    for (int k = 0; k < 3; ++k) {
      const int own = mesh.triangles(k, t);
      const Eigen::Vector3d normal = mesh.normals.col(own);
      const double sine = normal.dot(face) < least_cosine ? 1.0 : normal.cross(face).norm();
      tilt.on_faces = std::max(tilt.on_faces, sine);
      double& least = nearest[static_cast<std::size_t>(own)];
      least = std::min(least, sine);
      for (const int v :
           same_place[static_cast<std::size_t>(corner[static_cast<std::size_t>(own)])]) {
        const Eigen::Vector3d of_v = mesh.normals.col(v);
        const double rise = std::max(of_v.dot(p.col((k + 1) % 3) - p.col(k)),
                                     of_v.dot(p.col((k + 2) % 3) - p.col(k)));
        if (!(rise <= 0)) supports[static_cast<std::size_t>(v)] = 0;
      }
    }
  }
  for (std::size_t v = 0; v < n; ++v) {
    const bool of_no_face = nearest[v] > 1;
    if (supports[v] != 0 && !of_no_face) continue;
    tilt.at_vertices = std::max(tilt.at_vertices, std::min(1.0, nearest[v]));
  }
  return tilt;
}

}  // namespace lightrig
