#include "core/horizon.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/lanes.h"
#include "core/planner_kernels.h"

namespace lightrig {

namespace {

constexpr std::size_t vertices_in_cluster = 32, clusters_in_group = 8;

/// Spheres and vertices looked at together.
constexpr std::size_t most_at_once = 1024;

/// A vertex is near where it is less than one and a half of its edges away: there a triangle is too
/// large for the bound by its vertices.
constexpr double near_in_edges2 = 2.25;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The bits of a number below 1024, two apart.
std::uint32_t spread(std::uint32_t v) {
  v = (v | (v << 16)) & 0x030000FF;
  v = (v | (v << 8)) & 0x0300F00F;
  v = (v | (v << 4)) & 0x030C30C3;
  return (v | (v << 2)) & 0x09249249;
}

/// The finite vertices along a Morton curve: what is not a number blocks nothing and lies nowhere.
std::vector<std::int32_t> along_a_curve(const Eigen::Matrix3Xd& vertices) {
  const auto n = static_cast<std::size_t>(vertices.cols());
  std::vector<std::int32_t> order;
  for (std::size_t i = 0; i < n; ++i) {
    if (vertices.col(static_cast<Eigen::Index>(i)).allFinite()) {
      order.push_back(static_cast<std::int32_t>(i));
    }
  }
  if (order.empty()) return order;
  const Eigen::Vector3d least = vertices(Eigen::all, order).rowwise().minCoeff();
  const Eigen::Vector3d most = vertices(Eigen::all, order).rowwise().maxCoeff();
  const double size = std::max((most - least).maxCoeff(), 1e-300);
  std::vector<std::uint32_t> code(n);
  for (const std::int32_t v : order) {
    const auto i = static_cast<std::size_t>(v);
    for (int axis = 0; axis < 3; ++axis) {
      const double at = (vertices(axis, static_cast<Eigen::Index>(i)) - least[axis]) / size;
      code[i] |= spread(static_cast<std::uint32_t>(std::clamp(at * 1023.0, 0.0, 1023.0))) << axis;
    }
  }
  std::sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    return code[i] != code[j] ? code[i] < code[j] : a < b;
  });
  return order;
}

double ratio(double a, double d2) { return a > 0 ? (d2 > a * a ? a * a / d2 : 1.0) : 0.0; }

/// A corner of a triangle as seen from the origin: n·p and |p|².
struct Seen {
  Eigen::Vector3d p;
  double a, pp;
};

/// The greatest squared sine inside the segment from p to q, seen from the origin: along it n·d/|d|
/// has one extremum, where the derivative is 0.
double of_segment(const Seen& from, const Seen& to) {
  if (!(from.a > 0) && !(to.a > 0)) return 0;  // all of it below the horizontal
  const Eigen::Vector3d& p = from.p;
  const Eigen::Vector3d along = to.p - p;
  const double a = from.a, b = to.a - from.a, pp = from.pp, pq = p.dot(along),
               qq = along.squaredNorm();
  const double above = b * pp - a * pq, below = a * qq - b * pq;
  if (below == 0) return 0;
  const double t = above / below;
  if (!(t > 0 && t < 1)) return 0;
  return ratio(a + t * b, (p + t * along).squaredNorm());
}

/// Whether the direction n meets the triangle p, q, r: whether it is a sum of them with no negative
/// part.
bool meets(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::Vector3d& r,
           const Eigen::Vector3d& n) {
  const double whole = p.dot(q.cross(r));
  return n.dot(p.cross(q)) * whole >= 0 && n.dot(q.cross(r)) * whole >= 0 &&
         n.dot(r.cross(p)) * whole >= 0;
}

}  // namespace

void HorizonTree::Spheres::add(const Eigen::Vector3d& centre, double sphere_radius,
                               double longest_edge2) {
  x.push_back(centre.x());
  y.push_back(centre.y());
  z.push_back(centre.z());
  radius.push_back(sphere_radius);
  edge2.push_back(longest_edge2);
}

HorizonTree::HorizonTree(const Eigen::Matrix3Xd& vertices, const Eigen::Matrix3Xi& triangles)
    : level_(vector_level()) {
  const std::vector<std::int32_t> order = along_a_curve(vertices);
  if (order.empty()) return;
  vertices_ = vertices(Eigen::all, order);
  std::vector<std::int32_t> place(static_cast<std::size_t>(vertices.cols()), -1);
  for (std::size_t i = 0; i < order.size(); ++i) {
    place[static_cast<std::size_t>(order[i])] = static_cast<std::int32_t>(i);
  }
  take_triangles(triangles, place);
  build_spheres();
}

/// Triangles and longest edges at each vertex; `place` (vertices) is where they are in vertices_,
/// −1: nowhere.
void HorizonTree::take_triangles(const Eigen::Matrix3Xi& triangles,
                                 std::span<const std::int32_t> place) {
  const auto n = static_cast<std::size_t>(vertices_.cols());
  const std::size_t in_group = vertices_in_cluster * clusters_in_group;
  const std::size_t whole = (n + in_group - 1) / in_group * in_group;
  std::vector<double> edge2(n, 0.0);
  std::vector<std::array<std::int32_t, 3>> taken;
  taken.reserve(static_cast<std::size_t>(triangles.cols()));
  first_corner_.assign(whole + 1, 0);
  for (Eigen::Index t = 0; t < triangles.cols(); ++t) {
    std::array<std::int32_t, 3> at{};
    for (std::size_t c = 0; c < 3; ++c) {
      at[c] = place[static_cast<std::size_t>(triangles(static_cast<Eigen::Index>(c), t))];
    }
    if (std::min({at[0], at[1], at[2]}) < 0) continue;
    taken.push_back(at);
    for (std::size_t c = 0; c < 3; ++c) {
      const std::int32_t a = at[c], b = at[(c + 1) % 3];
      const double length2 = (vertices_.col(a) - vertices_.col(b)).squaredNorm();
      for (const std::int32_t v : {a, b}) {
        edge2[static_cast<std::size_t>(v)] = std::max(edge2[static_cast<std::size_t>(v)], length2);
      }
      ++first_corner_[static_cast<std::size_t>(a) + 1];
    }
  }
  std::partial_sum(first_corner_.begin(), first_corner_.end(), first_corner_.begin());
  corner_.resize(static_cast<std::size_t>(first_corner_.back()));
  std::vector<std::int32_t> next(first_corner_.begin(), first_corner_.end() - 1);
  for (const std::array<std::int32_t, 3>& at : taken) {
    for (std::size_t c = 0; c < 3; ++c) {
      const auto to = static_cast<std::size_t>(next[static_cast<std::size_t>(at[c])]++);
      corner_[to] = {at[(c + 1) % 3], at[(c + 2) % 3]};
    }
  }
  // The last vertex again and again, to whole groups: no loop has an end of its own.
  for (std::size_t i = 0; i < whole; ++i) {
    const std::size_t v = std::min(i, n - 1);
    points_.add(vertices_.col(static_cast<Eigen::Index>(v)), 0, edge2[v]);
  }
}

void HorizonTree::build_spheres() {
  const auto enclose = [](const Spheres& of, std::size_t together, Spheres& to) {
    for (std::size_t first = 0; first < of.size(); first += together) {
      const std::size_t last = std::min(first + together, of.size());
      Eigen::Vector3d low = Eigen::Vector3d::Constant(infinity), high = -low;
      for (std::size_t i = first; i < last; ++i) {
        const Eigen::Vector3d c(of.x[i], of.y[i], of.z[i]);
        low = low.cwiseMin(c);
        high = high.cwiseMax(c);
      }
      const Eigen::Vector3d centre = 0.5 * (low + high);
      double radius = 0, edge2 = 0;
      for (std::size_t i = first; i < last; ++i) {
        const Eigen::Vector3d c(of.x[i], of.y[i], of.z[i]);
        radius = std::max(radius, (c - centre).norm() + of.radius[i]);
        edge2 = std::max(edge2, of.edge2[i]);
      }
      to.add(centre, radius * (1 + 1e-12), edge2);
    }
  };
  enclose(points_, vertices_in_cluster, clusters_);
  enclose(clusters_, clusters_in_group, groups_);
  const std::size_t in_group = vertices_in_cluster * clusters_in_group;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const std::size_t i = std::min(g * in_group + in_group / 2, points_.size() - 1);
    middles_.add({points_.x[i], points_.y[i], points_.z[i]}, 0, points_.edge2[i]);
  }
}

/// Where one looks from, and the greatest squared sine found so far.
struct HorizonTree::Eye {
  double x, y, z, nx, ny, nz;

  /// Above 0 for spheres of which a vertex, or a triangle at one, may have a squared sine above
  /// `limit`. With d to a vertex and triangles that subtend no more than α = asin(e/|d|) about it,
  /// sin ≤ n·d / (|d| cos α); infinite where a vertex may be near.
  [[gnu::always_inline]] void excess(const Spheres& of, std::size_t first, std::size_t count,
                                     double limit, double* __restrict__ out) const {
    const double* __restrict__ sx = of.x.data() + first;
    const double* __restrict__ sy = of.y.data() + first;
    const double* __restrict__ sz = of.z.data() + first;
    const double* __restrict__ sr = of.radius.data() + first;
    const double* __restrict__ se = of.edge2.data() + first;
    for (std::size_t i = 0; i < count; ++i) {
      const double dx = sx[i] - x, dy = sy[i] - y, dz = sz[i] - z;
      const double a = nx * dx + ny * dy + nz * dz + sr[i];
      const double least = std::sqrt(dx * dx + dy * dy + dz * dz) - sr[i];
      const double d2 = least * least;
      const double far = a * a - limit * (d2 - se[i]);
      const double near = d2 >= near_in_edges2 * se[i] ? far : infinity;
      const double some = least > 0 ? near : infinity;
      out[i] = a > 0 ? some : -1.0;
    }
  }

  /// The same for vertices, which have no radius.
  [[gnu::always_inline]] void excess_of_vertices(const Spheres& of, std::size_t first,
                                                 std::size_t count, double limit,
                                                 double* __restrict__ out) const {
    const double* __restrict__ sx = of.x.data() + first;
    const double* __restrict__ sy = of.y.data() + first;
    const double* __restrict__ sz = of.z.data() + first;
    const double* __restrict__ se = of.edge2.data() + first;
    for (std::size_t i = 0; i < count; ++i) {
      const double dx = sx[i] - x, dy = sy[i] - y, dz = sz[i] - z;
      const double a = nx * dx + ny * dy + nz * dz;
      const double d2 = dx * dx + dy * dy + dz * dz;
      const double far = a * a - limit * (d2 - se[i]);
      const double some = d2 >= near_in_edges2 * se[i] ? far : infinity;
      out[i] = a > 0 ? some : -1.0;
    }
  }

  /// The squared sine that a vertex which is not near stands for.
  double of_vertex(const Spheres& of, std::size_t i) const {
    const double dx = of.x[i] - x, dy = of.y[i] - y, dz = of.z[i] - z;
    const double a = nx * dx + ny * dy + nz * dz;
    return a * a / (dx * dx + dy * dy + dz * dz - of.edge2[i]);
  }
};

/// The greatest squared sine of the triangles at a vertex: on their edges, or straight above.
double HorizonTree::of_triangles_at(std::size_t vertex, const Eigen::Vector3d& eye,
                                    const Eigen::Vector3d& n) const {
  const auto seen = [&](Eigen::Index v) {
    Seen corner;
    corner.p = vertices_.col(v) - eye;
    corner.a = n.dot(corner.p);
    corner.pp = corner.p.squaredNorm();
    return corner;
  };
  const auto first = static_cast<std::size_t>(first_corner_[vertex]),
             last = static_cast<std::size_t>(first_corner_[vertex + 1]);
  if (first == last) return 0;
  double best = 0;
  const Seen own = seen(static_cast<Eigen::Index>(vertex));
  best = ratio(own.a, own.pp);
  for (std::size_t c = first; c < last; ++c) {
    const Seen next = seen(corner_[c].next), other = seen(corner_[c].last);
    best = std::max({best, ratio(next.a, next.pp), ratio(other.a, other.pp), of_segment(own, next),
                     of_segment(next, other), of_segment(other, own)});
    if (meets(own.p, next.p, other.p, n)) return 1;
  }
  return best;
}

/// Goes down where something may be above what is found already, and some more: a horizon a little
/// too high costs a few rays, a closer look costs more. Gives up where little sky is left.
[[gnu::always_inline]] inline double HorizonTree::look(const Eye& from, const Eigen::Vector3d& eye,
                                                       const Eigen::Vector3d& n) const {
  constexpr double too_high = 0.7;
  std::array<double, most_at_once> of_group;
  std::array<double, clusters_in_group> of_cluster;
  std::array<double, vertices_in_cluster> of_vertex;
  double best = 0;
  const auto enough = [](double found) { return 1.25 * found + 0.003; };
  const auto look_at = [&](const Spheres& vertices, std::size_t i, double excess) {
    if (excess < infinity) {
      best = std::max(best, from.of_vertex(vertices, i));
    } else if (&vertices == &points_) {
      best = std::max(best, of_triangles_at(i, eye, n));
    }
  };
  for (std::size_t base = 0; base < groups_.size(); base += most_at_once) {
    const std::size_t here = std::min(most_at_once, groups_.size() - base);
    // A vertex of each group tells most of the horizon at once.
    from.excess_of_vertices(middles_, base, here, best, of_group.data());
    for (std::size_t g = 0; g < here; ++g) {
      if (of_group[g] > 0) look_at(middles_, base + g, of_group[g]);
    }
    from.excess(groups_, base, here, enough(best), of_group.data());
    for (std::size_t g = 0; g < here; ++g) {
      if (!(of_group[g] > 0)) continue;
      const std::size_t first = (base + g) * clusters_in_group;
      from.excess(clusters_, first, clusters_in_group, enough(best), of_cluster.data());
      for (std::size_t c = 0; c < clusters_in_group; ++c) {
        if (!(of_cluster[c] > 0)) continue;
        const std::size_t v = (first + c) * vertices_in_cluster;
        from.excess_of_vertices(points_, v, vertices_in_cluster, best, of_vertex.data());
        std::int64_t some = 0;  // mostly none
        for (std::size_t i = 0; i < vertices_in_cluster; ++i) some += of_vertex[i] > 0 ? 1 : 0;
        if (some == 0) continue;
        for (std::size_t i = 0; i < vertices_in_cluster; ++i) {
          if (of_vertex[i] > 0) look_at(points_, v + i, of_vertex[i]);
        }
        if (best > too_high) return 1;
      }
    }
  }
  return std::min(1.0, std::sqrt(enough(best)));
}

double HorizonTree::sine(const Eigen::Vector3d& eye, const Eigen::Vector3d& n) const {
  const Eye from{eye.x(), eye.y(), eye.z(), n.x(), n.y(), n.z()};
  return on_level(
      level_, [&]() __attribute__((always_inline)) { return look(from, eye, n); });
}

}  // namespace lightrig
