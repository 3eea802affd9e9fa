#include "core/shapes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>

#include "core/check.h"

namespace lightrig {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::Vector3i;
constexpr double pi = std::numbers::pi;

// A mesh in the making.
struct Builder {
  std::vector<Vector3d> vertices, normals;
  std::vector<Vector3i> triangles;

  int add(const Vector3d& position, const Vector3d& normal) {
    vertices.push_back(position);
    normals.push_back(normal);
    return static_cast<int>(vertices.size()) - 1;
  }
  // Corners counter-clockwise seen from outside.
  void add_quad(int a, int b, int c, int d) {
    triangles.emplace_back(a, b, c);
    triangles.emplace_back(a, c, d);
  }
  Mesh mesh() const {
    Mesh result;
    result.vertices.resize(3, static_cast<Eigen::Index>(vertices.size()));
    result.normals.resize(3, static_cast<Eigen::Index>(normals.size()));
    result.triangles.resize(3, static_cast<Eigen::Index>(triangles.size()));
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      result.vertices.col(static_cast<Eigen::Index>(i)) = vertices[i];
      result.normals.col(static_cast<Eigen::Index>(i)) = normals[i];
    }
    for (std::size_t i = 0; i < triangles.size(); ++i)
      result.triangles.col(static_cast<Eigen::Index>(i)) = triangles[i];
    return result;
  }
};

// The regular icosahedron: (0, ±1, ±φ) and its cyclic permutations, scaled to unit length.
const std::array<Vector3d, 12>& icosahedron() {
  static const std::array<Vector3d, 12> corners = [] {
    const double g = std::numbers::phi;
    std::array<Vector3d, 12> c = {Vector3d{-1, g, 0},  Vector3d{1, g, 0},   Vector3d{-1, -g, 0},
                                  Vector3d{1, -g, 0},  Vector3d{0, -1, g},  Vector3d{0, 1, g},
                                  Vector3d{0, -1, -g}, Vector3d{0, 1, -g},  Vector3d{g, 0, -1},
                                  Vector3d{g, 0, 1},   Vector3d{-g, 0, -1}, Vector3d{-g, 0, 1}};
    for (Vector3d& p : c) p.normalize();
    return c;
  }();
  return corners;
}

constexpr int icosahedron_faces[20][3] = {
    {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};

// A vertex of the divided icosahedron is a sum of at most three corners with whole weights; sorted
// (corner, weight) pairs name it, so that faces share the vertices of their edges exactly.
using GeodesicKey = std::array<std::pair<int, int>, 3>;

GeodesicKey key_of(const int (&face)[3], int a, int b, int c) {
  GeodesicKey key = {std::pair{face[0], a}, std::pair{face[1], b}, std::pair{face[2], c}};
  for (auto& [corner, weight] : key)
    if (weight == 0) corner = -1;
  std::sort(key.begin(), key.end());
  return key;
}

// One ring of a surface of revolution about z: `around` vertices at this radius and height.
int add_ring(Builder& builder, int around, double radius, double z, double normal_radial,
             double normal_z) {
  const int first = static_cast<int>(builder.vertices.size());
  for (int k = 0; k < around; ++k) {
    const double phi = 2 * pi * k / around;
    const double c = std::cos(phi), s = std::sin(phi);
    builder.add({radius * c, radius * s, z}, {normal_radial * c, normal_radial * s, normal_z});
  }
  return first;
}

// Quads between two rings of equal count; `lower` lies counter-clockwise-below `upper` from
// outside.
void join_rings(Builder& builder, int around, int lower, int upper) {
  for (int k = 0; k < around; ++k) {
    const int next = (k + 1) % around;
    builder.add_quad(lower + k, lower + next, upper + next, upper + k);
  }
}

// A flat disc at height z facing up (+1) or down (−1): a centre and `rings` rings.
void add_disc(Builder& builder, int around, int rings, double radius, double z, int facing) {
  const int centre = builder.add({0, 0, z}, {0, 0, static_cast<double>(facing)});
  int inner = -1;
  for (int r = 1; r <= rings; ++r) {
    const int ring =
        add_ring(builder, around, radius * (static_cast<double>(r) / rings), z, 0, facing);
    if (inner < 0) {
      for (int k = 0; k < around; ++k) {
        const int a = ring + k, b = ring + (k + 1) % around;
        builder.triangles.emplace_back(centre, facing > 0 ? a : b, facing > 0 ? b : a);
      }
    } else if (facing > 0) {
      join_rings(builder, around, ring, inner);
    } else {
      join_rings(builder, around, inner, ring);
    }
    inner = ring;
  }
}

}  // namespace

Mesh make_sphere(double radius, int fineness) {
  CHECK(radius > 0 && fineness >= 1);
  const int n = 16 * fineness;
  const std::array<Vector3d, 12>& corners = icosahedron();
  Builder builder;
  std::map<GeodesicKey, int> known;
  for (const auto& face : icosahedron_faces) {
    const auto vertex = [&](int a, int b) {
      const int c = n - a - b;
      const auto [entry, is_new] = known.try_emplace(key_of(face, a, b, c), 0);
      if (is_new) {
        // Add the corners in an order that does not depend on the face, so that the sum does not.
        Vector3d sum = Vector3d::Zero();
        for (const auto& [corner, weight] : entry->first)
          if (corner >= 0) sum += weight * corners[static_cast<std::size_t>(corner)];
        const Vector3d normal = sum.normalized();
        entry->second = builder.add(radius * normal, normal);
      }
      return entry->second;
    };
    for (int a = 0; a < n; ++a) {
      for (int b = 0; a + b < n; ++b) {
        builder.triangles.emplace_back(vertex(a, b), vertex(a + 1, b), vertex(a, b + 1));
        if (a + b + 1 < n)
          builder.triangles.emplace_back(vertex(a + 1, b), vertex(a + 1, b + 1), vertex(a, b + 1));
      }
    }
  }
  return builder.mesh();
}

Mesh make_plane(double width, double height, int fineness) {
  CHECK(width > 0 && height > 0 && fineness >= 1);
  const int n = 32 * fineness;
  Builder builder;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i)
      builder.add({width * (2 * i - n) / (2 * n), height * (2 * j - n) / (2 * n), 0}, {0, 0, 1});
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const int a = j * (n + 1) + i;
      builder.add_quad(a, a + 1, a + n + 2, a + n + 1);
    }
  }
  return builder.mesh();
}

Mesh make_cylinder(double radius, double height, int fineness) {
  CHECK(radius > 0 && height > 0 && fineness >= 1);
  const int around = 96 * fineness, along = 24 * fineness, rings = 12 * fineness;
  Builder builder;
  int below = -1;
  for (int k = 0; k <= along; ++k) {
    const int ring = add_ring(builder, around, radius,
                              height * (static_cast<double>(2 * k - along) / (2 * along)), 1, 0);
    if (below >= 0) join_rings(builder, around, below, ring);
    below = ring;
  }
  add_disc(builder, around, rings, radius, height / 2, +1);
  add_disc(builder, around, rings, radius, -height / 2, -1);
  return builder.mesh();
}

Mesh make_torus(double major, double minor, int fineness) {
  CHECK(major > minor && minor > 0 && fineness >= 1);
  const int around = 96 * fineness, tube = 48 * fineness;
  Builder builder;
  int first = -1, below = -1;
  for (int k = 0; k < tube; ++k) {
    const double t = 2 * pi * k / tube;  // rises on the outside
    const double c = std::cos(t), s = std::sin(t);
    const int ring = add_ring(builder, around, major + minor * c, minor * s, c, s);
    if (below >= 0) join_rings(builder, around, below, ring);
    if (first < 0) first = ring;
    below = ring;
  }
  join_rings(builder, around, below, first);
  return builder.mesh();
}

}  // namespace lightrig
