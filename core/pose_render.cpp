#include "core/pose_render.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "core/half_diff.h"
#include "core/parallel.h"

namespace lightrig {
namespace {

constexpr float highlight = 0.35F * (pose_columns::mean_knots - 1);  // 11° of θh

PoseBlocks blocks_of(const Mesh& mesh, const CameraModel& camera, int most) {
  double left = camera.width, right = -1, top = camera.height, bottom = -1;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Eigen::Vector2d p = project(camera, mesh.vertices.col(i));
    if (!p.allFinite()) continue;
    left = std::min(left, p.x());
    right = std::max(right, p.x());
    top = std::min(top, p.y());
    bottom = std::max(bottom, p.y());
  }
  const double margin = 0.04 * std::max(right - left, bottom - top) + 2;
  const auto inside = [](double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, double{1} * size));
  };
  PoseBlocks blocks;
  blocks.left = inside(left - margin, camera.width);
  blocks.top = inside(top - margin, camera.height);
  const int width = inside(right + margin + 1, camera.width) - blocks.left;
  const int height = inside(bottom + margin + 1, camera.height) - blocks.top;
  if (width <= 0 || height <= 0) return blocks;
  while ((width / blocks.edge) * (height / blocks.edge) > most) ++blocks.edge;
  blocks.across = width / blocks.edge;
  blocks.down = height / blocks.edge;
  return blocks;
}

/// Where in the block's n × n parts the samples lie: the same at every pose, and no two blocks
/// alike, so that rims meet no regular grid.
double jitter(int block, int sample, std::uint32_t salt) {
  auto z = static_cast<std::uint32_t>(block) * 2654435761U +
           static_cast<std::uint32_t>(sample) * 40503U + salt;
  z = (z ^ (z >> 15U)) * 2246822519U;
  z = (z ^ (z >> 13U)) * 3266489917U;
  z ^= z >> 16U;
  return (z >> 8U) * 0x1p-24;
}

/// Adds a hat function's two shares to the row.
template <class Row>
void add_hat(Row&& row, int first, int knots, float along, float share) {
  const int knot = std::min(knots - 2, static_cast<int>(along));
  const float above = along - static_cast<float>(knot);
  row[first + knot] += share * (1 - above);
  row[first + knot + 1] += share * above;
}

}  // namespace

struct PoseRenderer::Sight {
  CameraModel camera;
  LightPosition light;
};

struct PoseRenderer::Sample {
  bool hit = false;
  float irradiance = 0;  // E cos θi: 0 where unlit
  float along = 0;       // √θh, [0, 1]
  float cos_2phi = 0;    // of φd
  float tilt = 0;        // [rad] θd less that of the middle
};

PoseRenderer::PoseRenderer(const Mesh& mesh, const Occluder& occluder, const CameraModel& camera,
                           const LightPosition& light, int most, int threads)
    : mesh_(mesh),
      occluder_(occluder),
      camera_(camera),
      light_(light),
      blocks_(blocks_of(mesh, camera, most)),
      threads_(threads),
      convex_(occluder.convex()) {
  const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
  const auto theta_d = [&](const Eigen::Vector3d& x) {
    return theta_of_difference_tangent2(
        difference_tangent2(light.direction_from(x), view_direction(camera, x)));
  };
  middle_theta_d_ = theta_d((low + high) / 2);
  spread_theta_d_ = 1e-3;
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d x((corner & 1U) != 0 ? low.x() : high.x(),
                            (corner & 2U) != 0 ? low.y() : high.y(),
                            (corner & 4U) != 0 ? low.z() : high.z());
    spread_theta_d_ = std::max(spread_theta_d_, std::abs(theta_d(x) - middle_theta_d_));
  }
}

PoseRenderer::Sample PoseRenderer::sample(const Sight& sight, double u, double v) const {
  Sample out;
  const Ray ray = ray_through(sight.camera, u, v);
  const auto hit = occluder_.first_hit(ray);
  if (!hit) return out;
  out.hit = true;
  const Eigen::Vector3i corner = mesh_.triangles.col(hit->triangle);
  const double w = 1 - hit->u - hit->v;
  const Eigen::Vector3d x = ray.origin + hit->distance * ray.direction;
  const Eigen::Vector3d n =
      (w * mesh_.normals.col(corner[0]) + hit->u * mesh_.normals.col(corner[1]) +
       hit->v * mesh_.normals.col(corner[2]))
          .normalized();
  const Eigen::Vector3d l = sight.light.direction_from(x), o = -ray.direction;
  const double cos_i = n.dot(l);
  if (!(cos_i > 0) || !(n.dot(o) > 0)) return out;
  if (!convex_ && occluder_.blocked(x, n, sight.light)) return out;
  const Eigen::Vector3d h = (l + o).normalized();
  const double theta = theta_of_half_chord2(half_chord2(n.x(), n.y(), n.z(), h.x(), h.y(), h.z()));
  out.irradiance = static_cast<float>(sight.light.falloff(x) * cos_i);
  out.along = static_cast<float>(std::sqrt(std::min(1.0, theta / (std::numbers::pi / 2))));
  // φd is the azimuth about h of the light, from the great circle that leads on from n.
  const Eigen::Vector3d onwards = n.dot(h) * h - n;
  const double with = l.dot(onwards), across = l.dot(h.cross(onwards));
  const double both = with * with + across * across;
  if (both > 0) out.cos_2phi = static_cast<float>((with * with - across * across) / both);
  out.tilt =
      static_cast<float>(theta_of_difference_tangent2(difference_tangent2(l, o)) - middle_theta_d_);
  return out;
}

/// Four samples a block, nine in a highlight, and 36 where they differ in what they see: at rims
/// and shadows.
void PoseRenderer::paint(const Sight& sight, int block, std::uint32_t grain,
                         PosePicture& out) const {
  const double left = blocks_.left + (block % blocks_.across) * blocks_.edge - 0.5;
  const double top = blocks_.top + (block / blocks_.across) * blocks_.edge - 0.5;
  std::array<Sample, 36> samples;
  const auto take = [&](int n) {
    for (int i = 0; i < n * n; ++i)
      samples[static_cast<std::size_t>(i)] =
          sample(sight, left + (i % n + jitter(block, i, 16 * grain + 1)) / n * blocks_.edge,
                 top + (i / n + jitter(block, i, 16 * grain + 7)) / n * blocks_.edge);
    return n * n;
  };
  int count = take(2);
  const auto first = samples.begin(), last = samples.begin() + count;
  constexpr float knots = pose_columns::mean_knots - 1;
  const bool crossed = std::any_of(first, last, [&](const Sample& s) {
    return s.hit != samples[0].hit || (s.irradiance > 0) != (samples[0].irradiance > 0);
  });
  const bool bright = std::any_of(
      first, last, [](const Sample& s) { return s.irradiance > 0 && knots * s.along < highlight; });
  if (crossed) {
    count = take(6);
  } else if (bright) {
    count = take(3);
  }
  const float share = 1.0F / static_cast<float>(count);
  const auto spread = static_cast<float>(spread_theta_d_);
  auto row = out.shares.row(block);
  row.setZero();
  out.covered[block] = 0;
  for (int i = 0; i < count; ++i) {
    const Sample& s = samples[static_cast<std::size_t>(i)];
    if (!s.hit) continue;
    out.covered[block] += share;
    const float light = share * s.irradiance;
    constexpr float run = pose_columns::run_knots - 1;
    add_hat(row, 0, pose_columns::mean_knots, knots * s.along, light);
    add_hat(row, pose_columns::azimuth, pose_columns::run_knots, run * s.along, light * s.cos_2phi);
    add_hat(row, pose_columns::tilt, pose_columns::run_knots, run * s.along, light * s.tilt);
    const float across = std::clamp(0.5F + 0.5F * s.tilt / spread, 0.0F, 1.0F);
    add_hat(row, pose_columns::back, pose_columns::run_knots, run * across, light);
  }
  row[pose_columns::object] = out.covered[block];
  row[pose_columns::everywhere] = 1;
}

PosePicture PoseRenderer::at(const Eigen::Isometry3d& motion, std::uint32_t grain) const {
  // The object moved is camera and lamp moved the other way.
  Sight sight{camera_, light_};
  sight.camera.camera_from_world = camera_.camera_from_world * motion;
  const Eigen::Isometry3d back = motion.inverse();
  sight.light.p = light_.distant ? Eigen::Vector3d(back.linear() * light_.p) : back * light_.p;
  sight.light.aim = back.linear() * light_.aim;
  PosePicture out;
  out.shares.resize(blocks_.count(), pose_columns::count);
  out.covered.resize(blocks_.count());
  parallel_ranges(blocks_.count(), 64, threads_, [&](std::int64_t first, std::int64_t last, int) {
    for (std::int64_t block = first; block < last; ++block)
      paint(sight, static_cast<int>(block), grain, out);
  });
  return out;
}

}  // namespace lightrig
