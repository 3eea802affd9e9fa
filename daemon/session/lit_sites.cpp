#include "daemon/session/lit_sites.h"

#include <algorithm>
#include <cmath>

#include "core/half_diff.h"

namespace lightrig {
namespace {

constexpr double signal_sigmas = 10;  ///< a site compared stands this far above its noise
constexpr double stray_sigmas = 5;    ///< and differs when it is this far from where it was
constexpr double stray_share = 0.02;  ///< beside a model error of this share of the signal

bool within(const GrazingLimits& limits, const Eigen::Vector3d& n, const Eigen::Vector3d& wi,
            const Eigen::Vector3d& wo) {
  if (!(n.dot(wi) > limits.min_cos_i) || !(n.dot(wo) > limits.min_cos_o)) return false;
  if ((wi + wo).squaredNorm() < 1e-20) return false;
  return half_diff(n, wi, wo).theta_d <= limits.max_theta_d;
}

double variance_of(const SensorModel& sensor, double signal) {
  const double electrons = std::max(0.0, signal) * sensor.gain;
  return (electrons + sensor.read_noise * sensor.read_noise) / (sensor.gain * sensor.gain) +
         1.0 / 12.0;
}

}  // namespace

std::vector<LitPoint> lit_points(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                                 int shot) {
  const Shot& planned = prepared.plan.shots[static_cast<std::size_t>(shot)];
  const LightPosition& light = planned.light;
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, planned.gantry);
  const SurfacePoints& points = points_of_shot(prepared, shot);
  std::vector<Eigen::Vector3d> positions, normals;
  std::vector<LitPoint> lit;
  const int width = rig.camera.model.width, height = rig.camera.model.height;
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d x = points.position.col(i), n = points.normal.col(i);
    if (!within(spec.plan.limits, n, light.direction_from(x), points.view.col(i))) continue;
    if (!light.reaches(x)) continue;
    int site = points.source[static_cast<std::size_t>(i)];
    if (!points.from_pixels) {
      const Eigen::Vector2d pixel = project(camera, x);
      const int column = static_cast<int>(std::lround(pixel.x()));
      const int row = static_cast<int>(std::lround(pixel.y()));
      if (column < 0 || row < 0 || column >= width || row >= height) continue;
      site = row * width + column;
    }
    positions.push_back(x);
    normals.push_back(n);
    lit.push_back({static_cast<std::size_t>(site), x, n, points.view.col(i)});
  }
  std::vector<std::uint8_t> blocked(lit.size(), 0);
  prepared.occluder->blocked(positions, normals, light, blocked);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < lit.size(); ++i) {
    if (blocked[i] == 0) lit[kept++] = lit[i];
  }
  lit.resize(kept);
  return lit;
}

std::vector<std::uint8_t> lit_sites(const Rig& rig, const std::vector<LitPoint>& lit) {
  std::vector<std::uint8_t> sites(static_cast<std::size_t>(rig.camera.model.width) *
                                      static_cast<std::size_t>(rig.camera.model.height),
                                  0);
  for (const LitPoint& point : lit) sites[point.site] = 1;
  return sites;
}

std::vector<std::uint8_t> lit_sites(const Rig& rig, const SessionSpec& spec,
                                    const Prepared& prepared, int shot) {
  return lit_sites(rig, lit_points(rig, spec, prepared, shot));
}

FrameLikeness compare_frames(const Frame& then, const Frame& now,
                             const std::vector<std::uint8_t>& sites, const SensorModel& sensor) {
  FrameLikeness likeness;
  if (then.counts.counts.size() != now.counts.counts.size() ||
      sites.size() != then.counts.counts.size()) {
    return {.ratio = 0, .strayed = 1, .sites = 0};
  }
  const double white = 0.97 * sensor.white_level();
  std::vector<double> ratios;
  int strayed = 0;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (sites[i] == 0) continue;
    const double a = then.counts.counts[i] - sensor.black_level;
    const double b = now.counts.counts[i] - sensor.black_level;
    // Saturated now and not then is a change, and as much of one as can be seen.
    if (then.counts.counts[i] >= white && now.counts.counts[i] >= white) continue;
    const double noise = std::sqrt(variance_of(sensor, a) + variance_of(sensor, b));
    if (std::max(a, b) < signal_sigmas * noise) continue;
    ratios.push_back(b / std::max(a, 1.0));
    if (std::abs(a - b) > stray_sigmas * noise + stray_share * std::max(a, b)) ++strayed;
  }
  likeness.sites = static_cast<int>(ratios.size());
  if (ratios.empty()) return likeness;
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::ranges::nth_element(ratios, middle);
  likeness.ratio = *middle;
  likeness.strayed = static_cast<double>(strayed) / likeness.sites;
  return likeness;
}

}  // namespace lightrig
