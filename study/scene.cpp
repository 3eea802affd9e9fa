#include "study/scene.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <numbers>

#include "config/load_object.h"
#include "core/occlusion.h"
#include "core/surface_points.h"
#include "daemon/session/input_hash.h"

namespace lightrig {
namespace {

constexpr int image_side = 512;  // [px]

/// A built-in shape, a file, or NAME.ply of the folder of meshes. y is up and the view along −z;
/// shapes built with z up are laid to fit.
Result<ObjectConfig> object_config(const std::string& object, const StudyOptions& options) {
  ObjectConfig config;
  config.size = 0.1;
  const std::filesystem::path named = options.meshes / (object + ".ply");
  std::error_code ignored;
  if (!options.meshes.empty() && std::filesystem::exists(named, ignored)) {
    config.mesh = named;
    return config;
  }
  for (const char* shape : {"sphere", "teapot", "torus", "cylinder", "plane"}) {
    if (object != shape) continue;
    config.shape = shape;
    if (object != "sphere" && object != "plane") {
      config.world_from_object.linear() =
          Eigen::AngleAxisd(-std::numbers::pi / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();
    }
    return config;
  }
  if (std::filesystem::exists(object, ignored)) {
    config.mesh = object;
    return config;
  }
  return fail(ErrorCode::not_found,
              fmt::format("object {}: neither a built-in shape (sphere, teapot, torus, cylinder, "
                          "plane), nor a file, nor {} ; name a mesh file or the folder of meshes",
                          object, named.string()));
}

CameraModel camera_for(const Mesh& mesh) {
  const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
  const Eigen::Vector3d centre = (low + high) / 2, extent = high - low;
  CameraModel camera;
  camera.projection = CameraModel::Projection::orthographic;
  camera.width = camera.height = image_side;
  camera.fx = camera.fy = 0.94 * image_side / std::max(extent.x(), extent.y());
  camera.cx = camera.cy = (image_side - 1) / 2.0;
  camera.camera_from_world =
      look_at(centre + Eigen::Vector3d(0, 0, 10 * extent.norm()), centre, Eigen::Vector3d::UnitY());
  return camera;
}

}  // namespace

std::vector<LightPosition> lights_over_sphere(int count) {
  std::vector<LightPosition> lights;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count, r = std::sqrt(1 - z * z);
    lights.push_back({true, {r * std::cos(golden * i), r * std::sin(golden * i), z}});
  }
  return lights;
}

Result<StudyScene> make_scene(const std::string& object, const StudyOptions& options,
                              const BivariateGrid& grid, const std::vector<std::uint8_t>& valid) {
  const auto start = std::chrono::steady_clock::now();
  const Result<ObjectConfig> config = object_config(object, options);
  if (!config) return tl::unexpected(config.error());
  const Result<LoadedObject> loaded = load_object(*config);
  if (!loaded) return tl::unexpected(with_context("study", loaded.error()));
  const Occluder occluder(loaded->mesh);
  const CameraModel camera = camera_for(loaded->mesh);
  StudyScene scene;
  scene.object = std::filesystem::path(object).stem().string();
  scene.description = loaded->description;
  scene.mesh_sha256 = mesh_hash(loaded->mesh);
  scene.candidates = lights_over_sphere(options.candidates);
  const auto bins = [&](const SurfacePoints& points) {
    return bin_candidates(points, scene.candidates, grid, valid, no_grazing_limits, occluder,
                          ShadowRays::needed, options.threads)
        .bins;
  };
  scene.vertex_bins = bins(points_of_vertices(loaded->mesh, occluder, camera));
  scene.pixel_bins = bins(points_of_pixels(loaded->mesh, occluder, camera, 2));
  if (scene.vertex_bins.cell.empty()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("study: no light shows the camera any vertex of {}", object));
  }
  scene.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return scene;
}

const std::vector<Table1Entry>& table1_entries() {
  static const std::vector<Table1Entry> entries = {
      {"happy_buddha", "Buddha", {7, 9}, {4.47, 4.31}, {9.1, 8.17}, {1.8, 1.73}},
      {"bunny", "Bunny", {7, 9}, {4.67, 4.27}, {9.36, 7.65}, {1.92, 1.73}},
      {"dragon", "Dragon", {5, 7}, {4.95, 4.45}, {10.1, 8.81}, {2.3, 2.12}},
      {"head_igea", "Head", {5, 7}, {5.62, 4.83}, {11.2, 9.8}, {2.7, 2.25}},
      {"teapot", "Teapot", {9, 11}, {4.91, 4.72}, {11.5, 9.2}, {2.98, 2.43}},
      {"sphere", "Sphere", {5, 7}, {4.97, 4.48}, {7.95, 7.26}, {1.63, 1.1}},
  };
  return entries;
}

}  // namespace lightrig
