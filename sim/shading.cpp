#include "sim/shading.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/check.h"
#include "core/occlusion.h"
#include "sim/parallel.h"
#include "sim/philox.h"

namespace lightrig::sim {

HalfDiff angles_of(const Eigen::Vector3d& n, const Eigen::Vector3d& wi, const Eigen::Vector3d& wo) {
  const Eigen::Vector3d sum = wi + wo, difference = wi - wo;
  const Eigen::Vector3d h = sum.normalized();
  HalfDiff angles;
  // tan θd = |wi − wo| / |wi + wo|; tan θh = |n × sum| / n·sum.
  angles.theta_d = std::atan2(difference.norm(), sum.norm());
  angles.theta_h = std::atan2(n.cross(sum).norm(), n.dot(sum));
  // φd: azimuth of the light about h, from the great circle that runs from n through h onwards.
  const Eigen::Vector3d onwards = n.dot(h) * h - n;
  const double along = difference.dot(onwards);
  const double across = difference.dot(h.cross(onwards));
  double phi = std::atan2(across, along);
  if (phi < 0) phi += std::numbers::pi;
  if (phi >= std::numbers::pi) phi -= std::numbers::pi;
  angles.phi_d = phi;
  return angles;
}

Eigen::Array3d reflected(const Reflectance& reflectance, const Eigen::Vector3d& n,
                         const Eigen::Vector3d& wi, const Eigen::Vector3d& wo) {
  const double cos_i = n.dot(wi);
  // Light from exactly behind has no half vector, but cannot be above the horizon with wo either.
  if (!(cos_i > 0) || !(n.dot(wo) > 0)) return Eigen::Array3d::Zero();
  return reflectance(angles_of(n, wi, wo)) * cos_i;
}

namespace {

/// What the lamp sends this way as a share of what it sends along its axis, from the angle itself.
double share_of_axis(const LightPosition& light, const Eigen::Vector3d& to_light, double distance) {
  const EmissionLobe& lobe = light.lobe;
  if (light.distant || (lobe.angle.empty() && lobe.exponent == 0)) return 1;
  const double sine = light.aim.cross(to_light).norm() / distance;
  const double off = std::atan2(sine, -light.aim.dot(to_light) / distance);  // [rad] off the axis
  if (lobe.angle.empty()) {
    if (off >= std::numbers::pi / 2) return 0;
    return std::exp(lobe.exponent * std::log(std::max(1e-300, std::cos(off))));
  }
  std::size_t next = 0;
  while (next < lobe.angle.size() && lobe.angle[next] < off) ++next;
  if (next == lobe.angle.size()) return off == lobe.angle.back() ? lobe.intensity.back() : 0.0;
  if (next == 0) return lobe.intensity.front();
  const double width = lobe.angle[next] - lobe.angle[next - 1];
  return ((lobe.angle[next] - off) * lobe.intensity[next - 1] +
          (off - lobe.angle[next - 1]) * lobe.intensity[next]) /
         width;
}

/// One sample of one site that meets the object; 16 bytes, because a 20-megapixel view has many.
struct Sample {
  std::int32_t site;
  std::int32_t triangle;
  float u, v;
};

struct Surface {
  Eigen::Vector3d position;
  Eigen::Vector3d normal;
};

Surface surface_at(const Mesh& mesh, const Sample& sample) {
  const Eigen::Vector3i corner = mesh.triangles.col(sample.triangle);
  const double u = static_cast<double>(sample.u), v = static_cast<double>(sample.v), w = 1 - u - v;
  const auto blend = [&](const Eigen::Matrix3Xd& of) -> Eigen::Vector3d {
    return w * of.col(corner[0]) + u * of.col(corner[1]) + v * of.col(corner[2]);
  };
  return {blend(mesh.vertices), blend(mesh.normals).normalized()};
}

}  // namespace

struct Renderer::Scene {
  Scene(Mesh&& mesh_in, CameraModel camera_in, ColorFilter filter_in, Reflectance&& reflectance_in,
        const RenderOptions& options)
      : mesh(std::move(mesh_in)),
        camera(std::move(camera_in)),
        filter(filter_in),
        reflectance(std::move(reflectance_in)),
        strata(options.strata),
        threads(thread_count(options.threads)),
        occluder(mesh),
        convex(occluder.convex()) {}

  Mesh mesh;
  CameraModel camera;
  ColorFilter filter;
  Reflectance reflectance;
  int strata;
  int threads;
  Occluder occluder;
  bool convex;
  std::vector<std::vector<Sample>> rows;  ///< per image row, in order of sites
  std::int64_t sites_covered = 0;

  std::vector<Sample> see_row(int row, PhiloxKey key) const;
  void shade_row(int row, const LightPosition& light, const Eigen::Array3d& strength,
                 SiteRadiance& radiance) const;
};

std::vector<Sample> Renderer::Scene::see_row(int row, PhiloxKey key) const {
  std::vector<Sample> samples;
  for (int column = 0; column < camera.width; ++column) {
    const std::int32_t site = row * camera.width + column;
    for (int stratum = 0; stratum < strata * strata; ++stratum) {
      const PhiloxCounter bits = philox(
          {static_cast<std::uint32_t>(site), static_cast<std::uint32_t>(stratum), 0, 0}, key);
      const double in_u = (stratum % strata + uniform_open(bits[0], bits[1])) / strata;
      const double in_v = (stratum / strata + uniform_open(bits[2], bits[3])) / strata;
      const Ray ray = ray_through(camera, column - 0.5 + in_u, row - 0.5 + in_v);
      const std::optional<Hit> hit = occluder.first_hit(ray);
      if (!hit) continue;
      samples.push_back(
          {site, hit->triangle, static_cast<float>(hit->u), static_cast<float>(hit->v)});
    }
  }
  return samples;
}

void Renderer::Scene::shade_row(int row, const LightPosition& light, const Eigen::Array3d& strength,
                                SiteRadiance& radiance) const {
  std::vector<Eigen::Vector3d> points, normals;
  std::vector<std::int32_t> sites;
  for (const Sample& sample : rows[static_cast<std::size_t>(row)]) {
    const Surface surface = surface_at(mesh, sample);
    const Eigen::Vector3d to_light =
        light.distant ? light.p : Eigen::Vector3d(light.p - surface.position);
    if (!(surface.normal.dot(to_light) > 0)) continue;
    points.push_back(surface.position);
    normals.push_back(surface.normal);
    sites.push_back(sample.site);
  }
  std::vector<std::uint8_t> in_shadow(points.size(), 0);
  if (!convex && !points.empty()) occluder.blocked(points, normals, light, in_shadow);

  const double share = 1.0 / (strata * strata);
  std::vector<double> sums(static_cast<std::size_t>(camera.width), 0.0);
  const std::int32_t first_site = row * camera.width;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (in_shadow[i] != 0) continue;
    const std::int32_t column = sites[i] - first_site;
    const int channel = channel_at(filter, row, column);
    const Eigen::Vector3d to_light = light.distant ? light.p : Eigen::Vector3d(light.p - points[i]);
    const double r2 = light.distant ? 1.0 : to_light.squaredNorm();
    const Eigen::Array3d f_cos = reflected(reflectance, normals[i], to_light.normalized(),
                                           view_direction(camera, points[i]));
    // L = f cos θi · (I / r²), or · E of a distant lamp.
    sums[static_cast<std::size_t>(column)] += share * f_cos[channel] * strength[channel] *
                                              share_of_axis(light, to_light, std::sqrt(r2)) / r2;
  }
  for (std::size_t column = 0; column < sums.size(); ++column) {
    radiance[static_cast<std::size_t>(first_site) + column] = static_cast<float>(sums[column]);
  }
}

Renderer::Renderer(Mesh mesh, CameraModel camera, ColorFilter filter, Reflectance reflectance,
                   const RenderOptions& options) {
  CHECK(options.strata >= 1);
  auto scene = std::make_unique<Scene>(std::move(mesh), std::move(camera), filter,
                                       std::move(reflectance), options);
  const PhiloxKey key = derive_key(options.seed, {});
  scene->rows.resize(static_cast<std::size_t>(scene->camera.height));
  in_parallel(scene->threads, scene->camera.height, {}, [&](int row) {
    scene->rows[static_cast<std::size_t>(row)] = scene->see_row(row, key);
  });
  for (const std::vector<Sample>& row : scene->rows) {
    std::int32_t last = -1;
    for (const Sample& sample : row)
      scene->sites_covered += std::exchange(last, sample.site) != sample.site;
  }
  scene_ = std::move(scene);
}

Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

std::int64_t Renderer::sites_covered() const { return scene_->sites_covered; }

std::optional<SiteRadiance> Renderer::render(const LightPosition& light,
                                             const Eigen::Array3d& strength,
                                             const std::stop_token& stop) const {
  const CameraModel& camera = scene_->camera;
  SiteRadiance radiance(
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 0.0F);
  in_parallel(scene_->threads, camera.height, stop,
              [&](int row) { scene_->shade_row(row, light, strength, radiance); });
  if (stop.stop_requested()) return std::nullopt;
  return radiance;
}

}  // namespace lightrig::sim
