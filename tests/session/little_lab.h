#pragma once

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/half_diff.h"
#include "core/shapes.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/reduction.h"

namespace lightrig::test {

/// A reflectance of a few numbers: a Lambert base and a GGX-like lobe with Schlick's Fresnel.
struct Recipe {
  Eigen::Array3d diffuse{0.3, 0.3, 0.3};
  double specular = 0.05, roughness = 0.2;

  Reflectance reflectance() const {
    return [*this](const HalfDiff& a) -> Eigen::Array3d {
      const double alpha2 = roughness * roughness;
      const double c = std::cos(a.theta_h);
      const double d = c * c * (alpha2 - 1) + 1;
      const double fresnel = specular + (1 - specular) * std::pow(1 - std::cos(a.theta_d), 5);
      return diffuse / std::numbers::pi + alpha2 / (std::numbers::pi * d * d) * fresnel / 4;
    };
  }
};

/// Sixty such materials: every combination of a few values, the channels of each different.
inline std::vector<Material> recipe_materials() {
  std::vector<Material> materials;
  for (const double base : {0.02, 0.08, 0.2, 0.5, 0.8}) {
    for (const double specular : {0.03, 0.08, 0.3}) {
      for (const double roughness : {0.08, 0.15, 0.3, 0.55}) {
        const Recipe recipe{{base, 0.8 * base, 0.6 * base}, specular, roughness};
        materials.push_back({fmt::format("m{}", materials.size()), "recipe", "test",
                             tabulate(recipe.reflectance(), BivariateGrid{}, 1)});
      }
    }
  }
  return materials;
}

/// A rig, an object and frames of it without any of the rooms that usually make them: a unit sphere
/// whose pixels are intersected and shaded in closed form, with counts rounded by a sensor and
/// noise from a counter.
class LittleLab {
 public:
  explicit LittleLab(std::filesystem::path root, ColorFilter filter = ColorFilter::mono)
      : root_(std::move(root)) {
    CameraModel& camera = rig.camera.model;
    camera.width = 120;
    camera.height = 100;
    camera.fx = camera.fy = 330;
    camera.cx = 59.5;
    camera.cy = 49.5;
    camera.camera_from_world = look_at({0, -4, 0.5}, {0, 0, 0}, {0, 0, 1});
    SensorModel& sensor = rig.camera.sensor;
    sensor.filter = filter;
    sensor.bits = 12;
    sensor.gain = 4;
    sensor.black_level = 64;
    sensor.read_noise = 5;
    sensor.full_well = 16000;
    sensor.response = Eigen::Array3d::Constant(2e6);
    sensor.min_exposure = 1e-5;
    sensor.max_exposure = 10;
    rig.lamp.strength = {20, 22, 18};
    rig.name = "little lab";
    spec.estimator = Estimator::map;

    prepared.object.mesh = make_sphere(1, 6);
    prepared.occluder = std::make_shared<const Occluder>(prepared.object.mesh);
    prepared.points = points_of_pixels(prepared.object.mesh, *prepared.occluder, camera, 1);
    prepared.materials = recipe_materials();
    BasisOptions options;
    options.channels = sensor.channels();
    prepared.fit_basis = make_basis(prepared.materials, options).value();
    prepared.plan_basis = prepared.fit_basis;
    for (const double azimuth : {-1.2, -0.8, -0.3, 0.2, 0.6, 1.1}) {
      for (const double elevation : {-0.4, 0.1, 0.7}) {
        const double from_camera = azimuth - std::numbers::pi / 2;
        candidates.push_back(
            {false, 5 * Eigen::Vector3d(std::cos(elevation) * std::cos(from_camera),
                                        std::cos(elevation) * std::sin(from_camera),
                                        std::sin(elevation))});
      }
    }
    prepared.bins = bin_candidates(prepared.points, candidates, prepared.fit_basis.grid,
                                   prepared.fit_basis.valid, GrazingLimits{}, *prepared.occluder,
                                   ShadowRays::needed, 1)
                        .bins;
  }

  /// Plans these candidates, the last one held out.
  void plan(const std::vector<int>& chosen) {
    for (const int candidate : chosen) {
      Shot shot;
      shot.candidate = candidate;
      shot.light = candidates[static_cast<std::size_t>(candidate)];
      shot.held_out = candidate == chosen.back();
      prepared.plan.shots.push_back(shot);
    }
  }

  /// Takes and stores the bracket of a planned shot.
  CapturedShot capture(int index, const Reflectance& truth, const std::vector<double>& exposures,
                       double ambient = 0, bool ambient_frame = false) {
    CapturedShot shot;
    shot.index = index;
    shot.held_out = prepared.plan.shots[static_cast<std::size_t>(index)].held_out;
    shot.name = fmt::format("{}{:02}", shot.held_out ? "H" : "L", index + 1);
    shot.elapsed_s = 10.0 * (index + 1);
    const LightPosition& light = prepared.plan.shots[static_cast<std::size_t>(index)].light;
    for (std::size_t e = 0; e < exposures.size(); ++e) {
      shot.frames.push_back(store(fmt::format("{}-{}", shot.name, e), "bracket", exposures[e],
                                  &truth, light, ambient));
    }
    if (ambient_frame) {
      shot.frames.push_back(
          store(shot.name + "-a", "ambient", exposures.back(), nullptr, light, ambient));
    }
    return shot;
  }

  Rig rig;
  SessionSpec spec;
  Prepared prepared;
  std::vector<LightPosition> candidates;
  /// What is captured from now on lies in shadow from one column of the picture to before another.
  int shadow_from = 0, shadow_to = 0;
  SessionFolder folder() const { return {root_}; }

 private:
  // Radiance of one channel where a pixel's ray meets the unit sphere.
  double radiance(const Reflectance* truth, const LightPosition& light, double u, double v,
                  int channel) const {
    if (truth == nullptr) return 0;
    const Ray ray = ray_through(rig.camera.model, u, v);
    const double b = ray.origin.dot(ray.direction);
    const double under = b * b - (ray.origin.squaredNorm() - 1);
    if (under < 0) return 0;
    const Eigen::Vector3d x = ray.origin + (-b - std::sqrt(under)) * ray.direction;
    const Eigen::Vector3d n = x.normalized(), l = light.direction_from(x);
    if (n.dot(l) <= 0) return 0;
    const Eigen::Array3d f = (*truth)(half_diff(n, l, -ray.direction));
    const double one = rig.camera.sensor.filter == ColorFilter::mono ? f.mean() : f[channel];
    return one * rig.lamp.strength[channel] * light.falloff(x) * n.dot(l);
  }

  // Sum of twelve uniform numbers from a hash: near enough normal, the same everywhere.
  double noise() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) {
      counter_ = counter_ * 6364136223846793005ULL + 1442695040888963407ULL;
      sum += static_cast<double>(counter_ >> 40) / 16777216.0;
    }
    return sum;
  }

  StoredFrame store(const std::string& name, const std::string& role, double exposure,
                    const Reflectance* truth, const LightPosition& light, double ambient) {
    const SensorModel& sensor = rig.camera.sensor;
    Frame frame;
    frame.exposure = exposure;
    frame.counts.width = rig.camera.model.width;
    frame.counts.height = rig.camera.model.height;
    for (int row = 0; row < frame.counts.height; ++row) {
      for (int column = 0; column < frame.counts.width; ++column) {
        const int channel = channel_at(sensor.filter, row, column);
        const bool shadow = column >= shadow_from && column < shadow_to;
        const double lit = shadow ? 0 : radiance(truth, light, column, row, channel);
        const double seen = lit + ambient;
        double electrons = sensor.response[channel] * seen * exposure;
        electrons += noise() * std::sqrt(electrons + sensor.read_noise * sensor.read_noise);
        const double counts =
            sensor.black_level + std::min(electrons, sensor.full_well) / sensor.gain;
        frame.counts.counts.push_back(static_cast<std::uint16_t>(
            std::clamp(std::lround(counts), 0L, static_cast<long>(sensor.white_level()))));
      }
    }
    const std::string file = "frames/" + name + ".exr";
    const auto made = make_folder(root_ / "frames");
    const auto bytes = encode_frame(frame, sensor).value();
    const auto written = write_durably(root_ / file, bytes);
    if (!made || !written) std::abort();
    return {file, role, exposure, sha256_hex(bytes)};
  }

  std::filesystem::path root_;
  std::uint64_t counter_ = 1;
};

}  // namespace lightrig::test
