#include "core/mesh_repair.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

namespace lightrig {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Triangle = std::array<int, 3>;
using Place = std::array<double, 3>;
using Edge = std::pair<int, int>;

// A mesh under repair. Topology is that of places: vertices with one position and different normals
// (a crease) are still neighbours.
struct Draft {
  std::vector<Vector3d> vertices;
  std::vector<Vector3d> normals;    // zero where none is usable; empty if none was given
  std::vector<int> place;           // per vertex: the first vertex with its position
  std::vector<Triangle> triangles;  // vertex indices
  MeshRepairs repairs;

  int place_at(const Triangle& t, std::size_t corner) const {
    return place[static_cast<std::size_t>(t[corner])];
  }
  const Vector3d& corner(const Triangle& t, std::size_t k) const {
    return vertices[static_cast<std::size_t>(t[k])];
  }
  Vector3d area_vector(const Triangle& t) const {
    return 0.5 * (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0));
  }
};

Vector3d usable_normal(const Vector3d& n) {
  const double length = n.norm();
  if (!std::isfinite(length) || length < 1e-6) return Vector3d::Zero();
  return n / length;
}

// Vertices with their doubles merged. Returns the new index of every old vertex, −1 if dropped.
std::vector<int> take_vertices(const Mesh& mesh, Draft& draft) {
  const bool has_normals = mesh.normals.cols() == mesh.vertices.cols();
  std::map<Place, std::vector<int>> at_place;
  std::vector<int> new_index(static_cast<std::size_t>(mesh.vertices.cols()), -1);
  for (Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Vector3d p = mesh.vertices.col(i) + Vector3d::Zero();  // −0 + 0 is +0
    if (!p.allFinite()) {
      ++draft.repairs.non_finite_vertices;
      continue;
    }
    const Vector3d n = has_normals ? usable_normal(mesh.normals.col(i)) : Vector3d::Zero();
    std::vector<int>& here = at_place[{p.x(), p.y(), p.z()}];
    const auto same = std::find_if(here.begin(), here.end(), [&](int k) {
      const Vector3d& other = draft.normals[static_cast<std::size_t>(k)];
      const double cos_one_degree = 0.99985;
      return n.isZero() == other.isZero() && (n.isZero() || n.dot(other) > cos_one_degree);
    });
    int& index = new_index[static_cast<std::size_t>(i)];
    if (same != here.end()) {
      index = *same;
      ++draft.repairs.duplicate_vertices;
      continue;
    }
    index = static_cast<int>(draft.vertices.size());
    draft.vertices.push_back(p);
    draft.normals.push_back(n);
    here.push_back(index);
    draft.place.push_back(here.front());
  }
  return new_index;
}

void take_triangles(const Mesh& mesh, const std::vector<int>& new_index, Draft& draft) {
  std::set<Triangle> known;
  for (Index i = 0; i < mesh.triangles.cols(); ++i) {
    const Eigen::Vector3i old = mesh.triangles.col(i);
    if (old.minCoeff() < 0 || old.maxCoeff() >= mesh.vertices.cols()) {
      ++draft.repairs.degenerate_triangles;
      continue;
    }
    Triangle t;
    for (Index k = 0; k < 3; ++k)
      t[static_cast<std::size_t>(k)] = new_index[static_cast<std::size_t>(old[k])];
    if (std::min({t[0], t[1], t[2]}) < 0) continue;  // went with its non-finite vertex
    // No area beyond what rounding of its longest edge would give.
    const double longest = std::max({(draft.corner(t, 1) - draft.corner(t, 0)).norm(),
                                     (draft.corner(t, 2) - draft.corner(t, 1)).norm(),
                                     (draft.corner(t, 0) - draft.corner(t, 2)).norm()});
    if (draft.area_vector(t).norm() <= 1e-12 * longest * longest) {
      ++draft.repairs.degenerate_triangles;
      continue;
    }
    Triangle key = {draft.place_at(t, 0), draft.place_at(t, 1), draft.place_at(t, 2)};
    std::rotate(key.begin(), std::min_element(key.begin(), key.end()), key.end());
    if (!known.insert(key).second) {
      ++draft.repairs.duplicate_triangles;
      continue;
    }
    draft.triangles.push_back(t);
  }
}

struct EdgeUse {
  int triangle;
  bool forward;  // runs from the smaller place to the larger
};
using EdgeMap = std::map<Edge, std::vector<EdgeUse>>;

EdgeMap edges_of(const Draft& draft) {
  EdgeMap edges;
  for (std::size_t i = 0; i < draft.triangles.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = draft.place_at(draft.triangles[i], k);
      const int b = draft.place_at(draft.triangles[i], (k + 1) % 3);
      edges[std::minmax(a, b)].push_back({static_cast<int>(i), a < b});
    }
  }
  return edges;
}

// A part: triangles connected across edges that exactly two of them share.
struct Part {
  std::vector<int> triangles;
  std::vector<bool> reversed;  // against the first one's winding, to agree with its neighbours
  bool closed = true;
};

std::vector<Part> parts_of(const Draft& draft, const EdgeMap& edges) {
  struct Neighbour {
    int triangle;
    bool agrees;  // runs through the shared edge the other way, as it should
  };
  std::vector<std::vector<Neighbour>> neighbours(draft.triangles.size());
  std::vector<bool> at_boundary(draft.triangles.size(), false);
  for (const auto& [edge, uses] : edges) {
    if (uses.size() == 2) {
      const bool agrees = uses[0].forward != uses[1].forward;
      neighbours[static_cast<std::size_t>(uses[0].triangle)].push_back({uses[1].triangle, agrees});
      neighbours[static_cast<std::size_t>(uses[1].triangle)].push_back({uses[0].triangle, agrees});
    } else {
      for (const EdgeUse& use : uses) at_boundary[static_cast<std::size_t>(use.triangle)] = true;
    }
  }
  std::vector<Part> parts;
  std::vector<bool> seen(draft.triangles.size(), false);
  for (std::size_t start = 0; start < seen.size(); ++start) {
    if (seen[start]) continue;
    Part part{{static_cast<int>(start)}, {false}, true};
    seen[start] = true;
    for (std::size_t next = 0; next < part.triangles.size(); ++next) {
      const auto current = static_cast<std::size_t>(part.triangles[next]);
      if (at_boundary[current]) part.closed = false;
      for (const Neighbour& n : neighbours[current]) {
        if (seen[static_cast<std::size_t>(n.triangle)]) continue;
        seen[static_cast<std::size_t>(n.triangle)] = true;
        part.triangles.push_back(n.triangle);
        part.reversed.push_back(part.reversed[next] == n.agrees);
      }
    }
    parts.push_back(std::move(part));
  }
  return parts;
}

// Volume about its centroid of the part wound as its first triangle is, over that of a sphere with
// its area.
double relative_volume(const Draft& draft, const Part& part) {
  Vector3d centroid = Vector3d::Zero();
  double area = 0;
  for (const int i : part.triangles) {
    const Triangle& t = draft.triangles[static_cast<std::size_t>(i)];
    const double a = draft.area_vector(t).norm();
    centroid += a * (draft.corner(t, 0) + draft.corner(t, 1) + draft.corner(t, 2)) / 3;
    area += a;
  }
  centroid /= area;
  double volume = 0;
  for (std::size_t k = 0; k < part.triangles.size(); ++k) {
    const Triangle& t = draft.triangles[static_cast<std::size_t>(part.triangles[k])];
    const double cone = draft.area_vector(t).dot(draft.corner(t, 0) - centroid) / 3;
    volume += part.reversed[k] ? -cone : cone;
  }
  return volume / (std::pow(area, 1.5) / (6 * std::sqrt(std::numbers::pi)));
}

void orient(Draft& draft, const EdgeMap& edges) {
  for (const Part& part : parts_of(draft, edges)) {
    const auto odd = std::count(part.reversed.begin(), part.reversed.end(), true);
    const auto count = static_cast<std::ptrdiff_t>(part.reversed.size());
    const double volume = relative_volume(draft, part);
    const double clear = part.closed ? 1e-9 : 0.1;
    // Where the volume says nothing, the winding of the most triangles counts as meant.
    const bool turn_first = volume < -clear || (volume <= clear && 2 * odd > count);
    const std::ptrdiff_t turned = turn_first ? count - odd : odd;
    const bool turned_whole = 2 * turned > count;
    draft.repairs.flipped_orientation |= turned_whole;
    draft.repairs.rewound_triangles += static_cast<int>(turned_whole ? count - turned : turned);
    for (std::size_t k = 0; k < part.triangles.size(); ++k) {
      Triangle& t = draft.triangles[static_cast<std::size_t>(part.triangles[k])];
      if (part.reversed[k] != turn_first) std::swap(t[1], t[2]);
    }
  }
}

// Per vertex the sum of its place's triangle normals, weighted by their angles there.
std::vector<Vector3d> angle_weighted_normals(const Draft& draft) {
  std::vector<Vector3d> at_place(draft.vertices.size(), Vector3d::Zero());
  for (const Triangle& t : draft.triangles) {
    const Vector3d normal = draft.area_vector(t).normalized();
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d a = draft.corner(t, (k + 1) % 3) - draft.corner(t, k);
      const Vector3d b = draft.corner(t, (k + 2) % 3) - draft.corner(t, k);
      const double angle = std::atan2(a.cross(b).norm(), a.dot(b));
      at_place[static_cast<std::size_t>(draft.place_at(t, k))] += angle * normal;
    }
  }
  std::vector<Vector3d> result(draft.vertices.size());
  for (std::size_t i = 0; i < result.size(); ++i)
    result[i] = at_place[static_cast<std::size_t>(draft.place[i])];
  return result;
}

void settle_normals(Draft& draft) {
  const std::vector<Vector3d> computed = angle_weighted_normals(draft);
  std::vector<bool> used(draft.vertices.size(), false);
  for (const Triangle& t : draft.triangles)
    for (const int i : t) used[static_cast<std::size_t>(i)] = true;
  for (std::size_t i = 0; i < draft.normals.size(); ++i) {
    if (!used[i]) continue;
    Vector3d& n = draft.normals[i];
    if (n.isZero()) {
      draft.repairs.computed_normals = true;
      n = usable_normal(computed[i]);
      if (n.isZero()) n = Vector3d::UnitZ();  // both sides of a sheet: no side is better
    } else if (n.dot(computed[i]) < 0) {
      ++draft.repairs.turned_normals;
      n = -n;
    }
  }
}

int count_components(const Draft& draft) {
  std::vector<int> root(draft.vertices.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int i) {
    while (root[static_cast<std::size_t>(i)] != i) {
      int& up = root[static_cast<std::size_t>(i)];
      up = root[static_cast<std::size_t>(up)];
      i = up;
    }
    return i;
  };
  std::set<int> roots;
  for (const Triangle& t : draft.triangles)
    for (std::size_t k = 1; k < 3; ++k)
      root[static_cast<std::size_t>(find(draft.place_at(t, k)))] = find(draft.place_at(t, 0));
  for (const Triangle& t : draft.triangles) roots.insert(find(draft.place_at(t, 0)));
  return static_cast<int>(roots.size());
}

// Used vertices only, in their order.
Mesh packed(Draft& draft) {
  std::vector<int> new_index(draft.vertices.size(), -1);
  for (const Triangle& t : draft.triangles)
    for (const int i : t) new_index[static_cast<std::size_t>(i)] = 0;
  int count = 0;
  for (int& index : new_index)
    if (index == 0) index = count++;
  draft.repairs.unused_vertices = static_cast<int>(draft.vertices.size()) - count;
  Mesh mesh;
  mesh.vertices.resize(3, count);
  mesh.normals.resize(3, count);
  mesh.triangles.resize(3, static_cast<Index>(draft.triangles.size()));
  for (std::size_t i = 0; i < new_index.size(); ++i) {
    if (new_index[i] < 0) continue;
    mesh.vertices.col(new_index[i]) = draft.vertices[i];
    mesh.normals.col(new_index[i]) = draft.normals[i];
  }
  for (std::size_t i = 0; i < draft.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      mesh.triangles(static_cast<Index>(k), static_cast<Index>(i)) =
          new_index[static_cast<std::size_t>(draft.triangles[i][k])];
  return mesh;
}

}  // namespace

RepairedMesh repaired(const Mesh& mesh) {
  Draft draft;
  const std::vector<int> new_index = take_vertices(mesh, draft);
  take_triangles(mesh, new_index, draft);
  const EdgeMap edges = edges_of(draft);
  for (const auto& [edge, uses] : edges) {
    if (uses.size() == 1) ++draft.repairs.boundary_edges;
    if (uses.size() > 2) ++draft.repairs.non_manifold_edges;
  }
  orient(draft, edges);
  settle_normals(draft);
  draft.repairs.components = count_components(draft);
  Mesh result = packed(draft);
  return {std::move(result), draft.repairs};
}

double signed_volume(const Mesh& mesh, const Vector3d& origin) {
  double six_volumes = 0;
  for (Index i = 0; i < mesh.triangles.cols(); ++i) {
    const Eigen::Vector3i t = mesh.triangles.col(i);
    const Vector3d a = mesh.vertices.col(t[0]) - origin, b = mesh.vertices.col(t[1]) - origin,
                   c = mesh.vertices.col(t[2]) - origin;
    six_volumes += a.dot(b.cross(c));
  }
  return six_volumes / 6;
}

double surface_area(const Mesh& mesh) {
  double area = 0;
  for (Index i = 0; i < mesh.triangles.cols(); ++i) {
    const Eigen::Vector3i t = mesh.triangles.col(i);
    const Vector3d a = mesh.vertices.col(t[0]), b = mesh.vertices.col(t[1]),
                   c = mesh.vertices.col(t[2]);
    area += 0.5 * (b - a).cross(c - a).norm();
  }
  return area;
}

}  // namespace lightrig
