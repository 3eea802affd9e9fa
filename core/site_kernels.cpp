#include "core/site_kernels.h"

#include <cmath>

namespace lightrig {
namespace {

/// Says in place of chord2 where a point has none. One choice to a loop: then whole vectors go
/// through, and what is not lit costs no branch.
[[gnu::always_inline]] inline void say_what_is_dark(const SiteLimits& limits, std::size_t count,
                                                    SiteAngles& __restrict__ out) {
  const double min_i = limits.min_cos_i, min_o = limits.min_cos_o, tangent2 = limits.max_tangent2;
  constexpr double little = SiteAngles::grazing, none = SiteAngles::unlit;
  double* __restrict__ c = out.chord2;
  for (std::size_t i = 0; i < count; ++i) c[i] = out.cos_i[i] < min_i ? little : c[i];
  for (std::size_t i = 0; i < count; ++i) c[i] = out.cos_o[i] < min_o ? little : c[i];
  for (std::size_t i = 0; i < count; ++i) {
    c[i] = out.difference2[i] > tangent2 * out.sum2[i] ? little : c[i];
  }
  for (std::size_t i = 0; i < count; ++i) c[i] = out.cos_i[i] <= 0 ? none : c[i];
  for (std::size_t i = 0; i < count; ++i) c[i] = out.cos_o[i] <= 0 ? none : c[i];
  for (std::size_t i = 0; i < count; ++i) c[i] = out.sum2[i] < 1e-24 ? none : c[i];
}

[[gnu::always_inline]] inline void sites_body(const double* __restrict__ position,
                                              const double* __restrict__ normal,
                                              const double* __restrict__ view, std::size_t count,
                                              const LightPosition& light, const SiteLimits& limits,
                                              SiteAngles& __restrict__ out) {
  const double qx = light.p.x(), qy = light.p.y(), qz = light.p.z();
  const double near = light.distant ? 0.0 : 1.0;
  const double far = 1.0 - near;
  for (std::size_t i = 0; i < count; ++i) {
    const double nx = normal[3 * i], ny = normal[3 * i + 1], nz = normal[3 * i + 2];
    const double vx = view[3 * i], vy = view[3 * i + 1], vz = view[3 * i + 2];
    const double wx = qx - near * position[3 * i], wy = qy - near * position[3 * i + 1],
                 wz = qz - near * position[3 * i + 2];
    // A distant lamp is its direction, of length 1, and does not fall off.
    const double length2 = near * (wx * wx + (wy * wy + wz * wz)) + far;
    const double length = std::sqrt(length2);
    const double lx = wx / length, ly = wy / length, lz = wz / length;
    const double cos_i = nx * lx + ny * ly + nz * lz;
    const double sx = lx + vx, sy = ly + vy, sz = lz + vz;
    const double s2 = sx * sx + sy * sy + sz * sz;
    const double s = std::sqrt(s2);
    const double x = nx - sx / s, y = ny - sy / s, z = nz - sz / s;
    const double dx = lx - vx, dy = ly - vy, dz = lz - vz;
    out.cos_i[i] = cos_i;
    out.cos_o[i] = nx * vx + ny * vy + nz * vz;
    out.sum2[i] = s2;
    const double d2 = dx * dx + dy * dy + dz * dz;
    out.difference2[i] = d2;
    out.tangent2[i] = d2 / s2;
    out.chord2[i] = x * x + y * y + z * z;
    out.irradiance[i] = cos_i / length2;
  }
  say_what_is_dark(limits, count, out);
}

#if defined(__x86_64__)
[[gnu::target("arch=x86-64-v4,prefer-vector-width=512")]] void sites_v4(
    const double* position, const double* normal, const double* view, std::size_t count,
    const LightPosition& light, const SiteLimits& limits, SiteAngles& out) {
  sites_body(position, normal, view, count, light, limits, out);
}
[[gnu::target("arch=x86-64-v3")]] void sites_v3(const double* position, const double* normal,
                                                const double* view, std::size_t count,
                                                const LightPosition& light,
                                                const SiteLimits& limits, SiteAngles& out) {
  sites_body(position, normal, view, count, light, limits, out);
}
#endif

}  // namespace

void angles_of_sites(const double* position, const double* normal, const double* view,
                     std::size_t count, const LightPosition& light, const SiteLimits& limits,
                     SiteAngles& out, int level) {
#if defined(__x86_64__)
  if (level >= 4) return sites_v4(position, normal, view, count, light, limits, out);
  if (level == 3) return sites_v3(position, normal, view, count, light, limits, out);
#endif
  sites_body(position, normal, view, count, light, limits, out);
}

}  // namespace lightrig
