#include "daemon/session/image_sites.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <thread>

#include "core/check.h"
#include "core/half_diff.h"

namespace lightrig {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

// Sums over a block, per channel.
struct BlockSum {
  std::array<double, 3> sum{};
  std::array<int, 3> count{};
};

std::vector<BlockSum> sum_blocks(const ImageSites& sites, const std::vector<float>& radiance) {
  CHECK(radiance.size() == sites.points.source.size());
  std::vector<BlockSum> blocks(static_cast<std::size_t>(sites.width) *
                               static_cast<std::size_t>(sites.height));
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    const int site = sites.points.source[i];
    BlockSum& block = blocks[sites.block_of(site)];
    const auto channel = static_cast<std::size_t>(sites.channel_of(site));
    block.sum[channel] += static_cast<double>(radiance[i]);
    ++block.count[channel];
  }
  return blocks;
}

// Rows and columns of sites, first and last.
struct SiteBox {
  int left = 0, top = 0, right = 0, bottom = 0;
  int longest() const { return std::max(right - left, bottom - top) + 1; }
};

// Where the mesh falls on the sensor, by its vertices; the whole sensor when that cannot be said.
SiteBox outline_of(const Mesh& mesh, const CameraModel& camera) {
  Eigen::AlignedBox2d box;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Eigen::Vector2d pixel = project(camera, mesh.vertices.col(i));
    if (!pixel.allFinite()) return {0, 0, camera.width - 1, camera.height - 1};
    box.extend(pixel);
  }
  const Eigen::Vector2d last(camera.width - 1, camera.height - 1);
  const Eigen::Vector2d low = box.min().cwiseMax(0).cwiseMin(last);
  const Eigen::Vector2d high = box.max().cwiseMax(0).cwiseMin(last);
  return {static_cast<int>(low.x()), static_cast<int>(low.y()), static_cast<int>(high.x()),
          static_cast<int>(high.y())};
}

// Of the sites that do see the object: their first row and column, made even so that the mosaic's
// phase is kept.
SiteBox extent_of(const SurfacePoints& points, int sensor_width) {
  if (points.source.empty()) return {};
  SiteBox box{std::numeric_limits<int>::max(), std::numeric_limits<int>::max(), 0, 0};
  for (const int site : points.source) {
    box.left = std::min(box.left, site % sensor_width);
    box.right = std::max(box.right, site % sensor_width);
    box.top = std::min(box.top, site / sensor_width);
    box.bottom = std::max(box.bottom, site / sensor_width);
  }
  box.left -= box.left % 2;
  box.top -= box.top % 2;
  return box;
}

}  // namespace

ImageSites image_sites(const Mesh& mesh, const Occluder& occluder, const CameraModel& camera,
                       ColorFilter filter, int most_pixels) {
  CHECK(most_pixels > 0 && camera.width > 0 && camera.height > 0);
  constexpr int sites_across_block = 4;  // more would only smooth the noise further
  ImageSites sites;
  sites.filter = filter;
  sites.sensor_width = camera.width;
  sites.block = (outline_of(mesh, camera).longest() + most_pixels - 1) / most_pixels;
  if (filter != ColorFilter::mono) sites.block += sites.block % 2;
  sites.stride = (sites.block + sites_across_block - 1) / sites_across_block;
  if (filter != ColorFilter::mono && sites.stride % 2 == 0) --sites.stride;
  sites.points = points_of_pixels(mesh, occluder, camera, sites.stride);
  const SiteBox box = extent_of(sites.points, camera.width);
  sites.left = box.left;
  sites.top = box.top;
  sites.width = (box.right - box.left) / sites.block + 1;
  sites.height = (box.bottom - box.top) / sites.block + 1;
  return sites;
}

std::vector<float> captured_radiance(const ImageSites& sites, const RadianceImage& image,
                                     const RadianceImage* ambient) {
  std::vector<float> radiance(sites.points.source.size());
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    const auto site = static_cast<std::size_t>(sites.points.source[i]);
    radiance[i] = image.L[site];
    if (ambient != nullptr && ambient->site[site] != RadianceImage::Site::saturated) {
      radiance[i] -= ambient->L[site];
    }
  }
  return radiance;
}

std::vector<float> predicted_radiance(const ImageSites& sites, const BrdfLookup& brdf,
                                      const LightPosition& light, const Eigen::Array3d& strength,
                                      const Occluder& occluder, int threads) {
  const SurfacePoints& points = sites.points;
  std::vector<float> radiance(points.source.size(), 0.0F);
  const auto shade = [&](Eigen::Index first, Eigen::Index last) {
    for (Eigen::Index i = first; i < last; ++i) {
      const Eigen::Vector3d x = points.position.col(i), n = points.normal.col(i);
      const Eigen::Vector3d v = points.view.col(i), l = light.direction_from(x);
      const double cos_i = n.dot(l);
      // l = −v has no half vector; such a light is behind the object.
      if (cos_i <= 0 || (l + v).squaredNorm() < 1e-12) continue;
      if (!occluder.convex() && occluder.blocked(x, n, light)) continue;
      const HalfDiff angles = half_diff(n, l, v);
      const int channel = sites.channel_of(points.source[static_cast<std::size_t>(i)]);
      const double f = brdf(angles.theta_h, angles.theta_d, std::min(channel, brdf.channels() - 1));
      radiance[static_cast<std::size_t>(i)] =
          static_cast<float>(f * strength[channel] * light.falloff(x) * cos_i);
    }
  };
  const Eigen::Index n = points.size();
  std::vector<std::jthread> workers;
  for (int t = 1; t < threads; ++t) {
    workers.emplace_back(shade, n * t / threads, n * (t + 1) / threads);
  }
  shade(0, n / std::max(1, threads));
  return radiance;
}

LinearImage block_image(const ImageSites& sites, const std::vector<float>& radiance) {
  LinearImage image{sites.width, sites.height, {}};
  for (const BlockSum& block : sum_blocks(sites, radiance)) {
    Eigen::Array3f pixel = Eigen::Array3f::Constant(nan);
    const bool all_colours = sites.filter == ColorFilter::mono
                                 ? block.count[0] > 0
                                 : std::ranges::all_of(block.count, [](int n) { return n > 0; });
    for (std::size_t c = 0; all_colours && c < 3; ++c) {
      const std::size_t channel = sites.filter == ColorFilter::mono ? 0 : c;
      pixel[static_cast<int>(c)] = static_cast<float>(block.sum[channel] / block.count[channel]);
    }
    image.pixels.push_back(pixel);
  }
  return image;
}

std::vector<float> relative_difference(const ImageSites& sites, const std::vector<float>& captured,
                                       const std::vector<float>& predicted) {
  const std::vector<BlockSum> seen = sum_blocks(sites, captured);
  const std::vector<BlockSum> expected = sum_blocks(sites, predicted);
  std::vector<float> difference(seen.size(), nan);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    double captured_sum = 0, predicted_sum = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      captured_sum += seen[i].sum[c];
      predicted_sum += expected[i].sum[c];
    }
    if (captured_sum > 0 && predicted_sum > 0) {
      difference[i] = static_cast<float>((predicted_sum - captured_sum) / captured_sum);
    }
  }
  return difference;
}

}  // namespace lightrig
