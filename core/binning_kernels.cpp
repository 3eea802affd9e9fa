#include "core/binning_kernels.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/lanes.h"

namespace lightrig {

namespace {

[[gnu::always_inline]] inline void take_square_roots(Lanes& x) {
  double roots[lane_width];
  for (int j = 0; j < lane_width; ++j) roots[j] = std::sqrt(x[j]);
  x = lanes_at(roots);
}

[[gnu::always_inline]] inline void angles_body(const PointColumns& points, std::size_t first,
                                               const LightPosition& light, double min_cos_i,
                                               double max_tangent2, std::size_t count,
                                               double* __restrict__ chord2,
                                               double* __restrict__ tangent2) {
  const double* __restrict__ px = points.px.data() + first;
  const double* __restrict__ py = points.py.data() + first;
  const double* __restrict__ pz = points.pz.data() + first;
  const double* __restrict__ nx = points.nx.data() + first;
  const double* __restrict__ ny = points.ny.data() + first;
  const double* __restrict__ nz = points.nz.data() + first;
  const double* __restrict__ vx = points.vx.data() + first;
  const double* __restrict__ vy = points.vy.data() + first;
  const double* __restrict__ vz = points.vz.data() + first;
  const double qx = light.p.x(), qy = light.p.y(), qz = light.p.z();
  // A distant lamp is its direction: the way to it is not measured from the point, nor scaled.
  const double near = light.distant ? 0.0 : 1.0;
  const Lanes none = Lanes{} + unlit, no_half = Lanes{} + no_half_vector;
  for (std::size_t i = 0; i < count; i += lane_width) {
    const Lanes wx = qx - near * lanes_at(px + i), wy = qy - near * lanes_at(py + i),
                wz = qz - near * lanes_at(pz + i);
    Lanes length = Lanes{} + 1.0;
    if (!light.distant) {
      length = wx * wx + (wy * wy + wz * wz);
      take_square_roots(length);
    }
    const Lanes lx = wx / length, ly = wy / length, lz = wz / length;
    const Lanes n_x = lanes_at(nx + i), n_y = lanes_at(ny + i), n_z = lanes_at(nz + i);
    const Lanes v_x = lanes_at(vx + i), v_y = lanes_at(vy + i), v_z = lanes_at(vz + i);
    const Lanes cos_i = n_x * lx + n_y * ly + n_z * lz;
    const Lanes sx = lx + v_x, sy = ly + v_y, sz = lz + v_z;
    const Lanes s2 = sx * sx + sy * sy + sz * sz;
    Lanes s = s2;
    take_square_roots(s);
    const Lanes x = n_x - sx / s, y = n_y - sy / s, z = n_z - sz / s;
    const Lanes dx = lx - v_x, dy = ly - v_y, dz = lz - v_z;
    const Lanes t2 = (dx * dx + dy * dy + dz * dz) / s2;
    const Lanes c2 = x * x + y * y + z * z;
    const Lanes within = t2 <= max_tangent2 ? c2 : none;
    const Lanes defined = s2 > 0 ? within : no_half;
    const Lanes lit = cos_i > 0 ? defined : none;
    lanes_at(chord2 + i) = cos_i >= min_cos_i ? lit : none;
    lanes_at(tangent2 + i) = t2;
  }
}

[[gnu::always_inline]] inline void bundles_body(const NormalBundles& bundles,
                                                const Eigen::Vector3d& l, const Eigen::Vector3d& h,
                                                double* __restrict__ cosine,
                                                double* __restrict__ least,
                                                double* __restrict__ greatest) {
  const double* __restrict__ bx = bundles.x.data();
  const double* __restrict__ by = bundles.y.data();
  const double* __restrict__ bz = bundles.z.data();
  const double* __restrict__ br = bundles.radius.data();
  const double lx = l.x(), ly = l.y(), lz = l.z(), hx = h.x(), hy = h.y(), hz = h.z();
  const std::size_t count = bundles.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double x = bx[i] - hx, y = by[i] - hy, z = bz[i] - hz;
    const double chord = std::sqrt(x * x + y * y + z * z);
    const double inner = chord - br[i];
    const double outer = chord + br[i];
    cosine[i] = bx[i] * lx + by[i] * ly + bz[i] * lz + br[i];
    least[i] = inner > 0 ? inner * inner : 0.0;
    greatest[i] = outer * outer;
  }
}

#if defined(__x86_64__)
[[gnu::target("arch=x86-64-v4,prefer-vector-width=512")]] void angles_v4(
    const PointColumns& points, std::size_t first, const LightPosition& light, double min_cos_i,
    double max_tangent2, std::size_t count, double* chord2, double* tangent2) {
  angles_body(points, first, light, min_cos_i, max_tangent2, count, chord2, tangent2);
}
[[gnu::target("arch=x86-64-v3")]] void angles_v3(const PointColumns& points, std::size_t first,
                                                 const LightPosition& light, double min_cos_i,
                                                 double max_tangent2, std::size_t count,
                                                 double* chord2, double* tangent2) {
  angles_body(points, first, light, min_cos_i, max_tangent2, count, chord2, tangent2);
}
[[gnu::target("arch=x86-64-v4,prefer-vector-width=512")]] void bundles_v4(
    const NormalBundles& bundles, const Eigen::Vector3d& l, const Eigen::Vector3d& h,
    double* cosine, double* least, double* greatest) {
  bundles_body(bundles, l, h, cosine, least, greatest);
}
[[gnu::target("arch=x86-64-v3")]] void bundles_v3(const NormalBundles& bundles,
                                                  const Eigen::Vector3d& l,
                                                  const Eigen::Vector3d& h, double* cosine,
                                                  double* least, double* greatest) {
  bundles_body(bundles, l, h, cosine, least, greatest);
}
#endif

/// Square of the octahedral map that a unit vector falls into [Meyer 2010], side × side
/// squares.
int octahedral_square(double x, double y, double z, int side) {
  const double sum = std::abs(x) + std::abs(y) + std::abs(z);
  double u = x / sum, v = y / sum;
  if (z < 0) {
    const double folded = (1 - std::abs(v)) * std::copysign(1.0, u);
    v = (1 - std::abs(u)) * std::copysign(1.0, v);
    u = folded;
  }
  const auto square = [&](double t) {
    return std::clamp(static_cast<int>(0.5 * (t + 1) * side), 0, side - 1);
  };
  return square(v) * side + square(u);
}

void reorder(std::vector<double>& values, const std::vector<std::size_t>& order) {
  std::vector<double> sorted(values.size());
  for (std::size_t i = 0; i < order.size(); ++i) sorted[i] = values[order[i]];
  values = std::move(sorted);
}

}  // namespace

void PointColumns::pad() {
  for (std::vector<double>* column : {&px, &py, &pz, &nx, &ny, &nz, &vx, &vy, &vz}) {
    column->resize(size() + lane_width, 0.0);
  }
}

void angles_of_points(const PointColumns& points, std::size_t first, const LightPosition& light,
                      double min_cos_i, double max_tangent2, std::span<double> chord2,
                      std::span<double> tangent2, int level) {
  const std::size_t count = chord2.size();
#if defined(__x86_64__)
  if (level >= 4) {
    return angles_v4(points, first, light, min_cos_i, max_tangent2, count, chord2.data(),
                     tangent2.data());
  }
  if (level == 3) {
    return angles_v3(points, first, light, min_cos_i, max_tangent2, count, chord2.data(),
                     tangent2.data());
  }
#endif
  angles_body(points, first, light, min_cos_i, max_tangent2, count, chord2.data(), tangent2.data());
}

void bundle_ranges(const NormalBundles& bundles, const Eigen::Vector3d& l, const Eigen::Vector3d& h,
                   std::span<double> greatest_cosine, std::span<double> least_chord2,
                   std::span<double> greatest_chord2, int level) {
  double* cosine = greatest_cosine.data();
  double* least = least_chord2.data();
  double* greatest = greatest_chord2.data();
#if defined(__x86_64__)
  if (level >= 4) return bundles_v4(bundles, l, h, cosine, least, greatest);
  if (level == 3) return bundles_v3(bundles, l, h, cosine, least, greatest);
#endif
  bundles_body(bundles, l, h, cosine, least, greatest);
}

NormalBundles bundle_normals(PointColumns& points, int size) {
  const std::size_t n = points.size();
  const int side = std::max(1, static_cast<int>(std::sqrt(2.0 * static_cast<double>(n) / size)));
  std::vector<std::int32_t> start(
      static_cast<std::size_t>(side) * static_cast<std::size_t>(side) + 1, 0);
  std::vector<int> square(n);
  for (std::size_t i = 0; i < n; ++i) {
    square[i] = octahedral_square(points.nx[i], points.ny[i], points.nz[i], side);
    ++start[static_cast<std::size_t>(square[i]) + 1];
  }
  std::partial_sum(start.begin(), start.end(), start.begin());
  std::vector<std::size_t> order(n);
  std::vector<std::int32_t> next(start.begin(), start.end() - 1);
  for (std::size_t i = 0; i < n; ++i) {
    order[static_cast<std::size_t>(next[static_cast<std::size_t>(square[i])]++)] = i;
  }
  for (std::vector<double>* column : {&points.px, &points.py, &points.pz, &points.nx, &points.ny,
                                      &points.nz, &points.vx, &points.vy, &points.vz}) {
    reorder(*column, order);
  }
  const std::vector<std::int32_t> index = points.index;
  for (std::size_t i = 0; i < n; ++i) points.index[i] = index[order[i]];

  NormalBundles bundles;
  for (std::size_t s = 0; s + 1 < start.size(); ++s) {
    if (start[s] == start[s + 1]) continue;
    const auto first = static_cast<std::size_t>(start[s]),
               last = static_cast<std::size_t>(start[s + 1]);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t i = first; i < last; ++i) {
      mean += Eigen::Vector3d(points.nx[i], points.ny[i], points.nz[i]);
    }
    mean.normalize();
    double radius = 0;
    for (std::size_t i = first; i < last; ++i) {
      radius = std::max(radius,
                        (Eigen::Vector3d(points.nx[i], points.ny[i], points.nz[i]) - mean).norm());
    }
    bundles.x.push_back(mean.x());
    bundles.y.push_back(mean.y());
    bundles.z.push_back(mean.z());
    bundles.radius.push_back(radius + 1e-12);  // far above the rounding of what is compared with it
    bundles.first.push_back(start[s]);
  }
  bundles.first.push_back(static_cast<std::int32_t>(n));
  return bundles;
}

}  // namespace lightrig
