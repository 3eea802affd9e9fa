#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <map>

#include "core/check.h"
#include "core/shapes.h"
#include "core/teapot_patches.h"

namespace lightrig {
namespace {

using Eigen::Vector3d;

// Cubic Bernstein polynomials and their derivatives.
struct Bernstein {
  std::array<double, 4> value, slope;
};
Bernstein bernstein(double t) {
  const double s = 1 - t;
  return {{s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t},
          {-3 * s * s, 3 * s * (s - 2 * t), 3 * t * (2 * s - t), 3 * t * t}};
}

Vector3d combine(const BicubicPatch& patch, const std::array<double, 4>& u,
                 const std::array<double, 4>& v) {
  Vector3d sum = Vector3d::Zero();
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j) sum += u[i] * v[j] * patch[4 * i + j];
  return sum;
}

// Points of neighbouring patches at one place. Control points are multiples of 1e-4 and edges are
// shared, so that equal points agree to rounding.
using Place = std::array<long, 3>;
Place place_of(const Vector3d& p) {
  return {std::lround(p.x() * 1e7), std::lround(p.y() * 1e7), std::lround(p.z() * 1e7)};
}

// Vertices of the tessellation, each once. Where patches meet smoothly their normals agree; where
// the handle's end touches the body they do not, and both vertices stay.
class Vertices {
 public:
  int add(const PatchPoint& point) {
    std::vector<int>& here = places_[place_of(point.position)];
    for (const int index : here)
      if (points[static_cast<std::size_t>(index)].normal.dot(point.normal) > 0.999) return index;
    here.push_back(static_cast<int>(points.size()));
    points.push_back(point);
    return here.back();
  }
  std::vector<PatchPoint> points;

 private:
  std::map<Place, std::vector<int>> places_;
};

// Extremes of the exact surface along x: the handle reaches the control points x = −3 where two of
// its patches meet; the lip of the spout is the cubic 3.3, 3.525, 3.45, 3.2, whose greatest value
// is where 0.225 − 0.6 t + 0.125 t² = 0.
double centre_x() {
  const double t = (0.6 - std::sqrt(0.36 - 0.1125)) / 0.25;
  const Bernstein b = bernstein(t);
  const double lip = 3.3 * b.value[0] + 3.525 * b.value[1] + 3.45 * b.value[2] + 3.2 * b.value[3];
  return (lip - 3.0) / 2;
}

}  // namespace

PatchPoint evaluate(const BicubicPatch& patch, double u, double v) {
  const Bernstein bu = bernstein(u), bv = bernstein(v);
  Vector3d du = combine(patch, bu.slope, bv.value);
  Vector3d dv = combine(patch, bu.value, bv.slope);
  // Where a whole edge is one point, ∂P/∂v vanishes on it as the distance from the edge; its
  // direction there is that of the mixed derivative, away from the point (turned at u = 1).
  constexpr double vanishing = 1e-9;
  if (dv.norm() < vanishing)
    dv = (u < 0.5 ? 1.0 : -1.0) * combine(patch, bu.slope, bv.slope);
  else if (du.norm() < vanishing)
    du = (v < 0.5 ? 1.0 : -1.0) * combine(patch, bu.slope, bv.slope);
  return {combine(patch, bu.value, bv.value), dv.cross(du).normalized()};
}

Mesh tessellate_teapot(int segments) {
  CHECK(segments >= 1);
  Vertices vertices;
  std::vector<Eigen::Vector3i> triangles;
  const int n = segments;
  const auto across = static_cast<std::size_t>(n) + 1;
  std::vector<int> index(across * across);
  const auto at = [&](int i, int j) -> int& {
    return index[static_cast<std::size_t>(i) * across + static_cast<std::size_t>(j)];
  };
  for (const BicubicPatch& patch : teapot_patches()) {
    for (int i = 0; i <= n; ++i)
      for (int j = 0; j <= n; ++j)
        at(i, j) =
            vertices.add(evaluate(patch, static_cast<double>(i) / n, static_cast<double>(j) / n));
    const auto add = [&](int a, int b, int c) {
      if (a != b && b != c && c != a) triangles.emplace_back(a, b, c);  // else at a pole
    };
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        add(at(i, j), at(i, j + 1), at(i + 1, j + 1));
        add(at(i, j), at(i + 1, j + 1), at(i + 1, j));
      }
    }
  }
  const std::vector<PatchPoint>& points = vertices.points;
  Mesh mesh;
  mesh.vertices.resize(3, static_cast<Eigen::Index>(points.size()));
  mesh.normals.resize(3, static_cast<Eigen::Index>(points.size()));
  mesh.triangles.resize(3, static_cast<Eigen::Index>(triangles.size()));
  for (std::size_t k = 0; k < points.size(); ++k) {
    mesh.vertices.col(static_cast<Eigen::Index>(k)) = points[k].position;
    mesh.normals.col(static_cast<Eigen::Index>(k)) = points[k].normal;
  }
  for (std::size_t k = 0; k < triangles.size(); ++k)
    mesh.triangles.col(static_cast<Eigen::Index>(k)) = triangles[k];
  return mesh;
}

Mesh make_teapot(double height, int fineness) {
  CHECK(height > 0 && fineness >= 1);
  Mesh mesh = tessellate_teapot(10 * fineness);
  constexpr double published_height = 3.15;
  const Vector3d centre(centre_x(), 0, published_height / 2);
  mesh.vertices = (mesh.vertices.colwise() - centre) * (height / published_height);
  return mesh;
}

}  // namespace lightrig
