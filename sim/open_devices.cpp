#include "sim/open_devices.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <utility>

#include "config/load_object.h"
#include "core/shapes.h"
#include "sim/memory_devices.h"
#include "sim/world.h"

namespace lightrig::sim {
namespace {

/// The object as it really lies: turned about its centroid by `angle` [rad] around an axis that the
/// seed chooses.
Mesh misplaced(Mesh mesh, double angle, std::uint64_t seed) {
  if (angle == 0 || mesh.vertices.cols() == 0) return mesh;
  constexpr std::uint64_t pose_error = 3;
  const PhiloxKey key = derive_key(seed, std::span(&pose_error, 1));
  const Eigen::Vector3d axis =
      Eigen::Vector3d(standard_normal(0, key), standard_normal(1, key), standard_normal(2, key))
          .normalized();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  const Eigen::Vector3d centroid = mesh.vertices.rowwise().mean();
  mesh.vertices = (turn * (mesh.vertices.colwise() - centroid)).colwise() + centroid;
  mesh.normals = turn * mesh.normals;
  return mesh;
}

/// Both in one.
Mesh together(const Mesh& a, const Mesh& b) {
  Mesh both{Eigen::Matrix3Xd(3, a.vertices.cols() + b.vertices.cols()),
            Eigen::Matrix3Xd(3, a.normals.cols() + b.normals.cols()),
            Eigen::Matrix3Xi(3, a.triangles.cols() + b.triangles.cols())};
  both.vertices << a.vertices, b.vertices;
  both.normals << a.normals, b.normals;
  const auto first = static_cast<int>(a.vertices.cols());
  both.triangles << a.triangles, (b.triangles.array() + first).matrix();
  return both;
}

}  // namespace

Result<std::shared_ptr<World>> make_world(const Rig& rig, const ObjectConfig& object, Clock& clock,
                                          std::uint64_t seed) {
  auto truth = truth_of(rig);
  if (!truth) return tl::unexpected(with_context("simulate the rig", truth.error()));
  auto loaded = load_object(object);
  if (!loaded) return tl::unexpected(with_context("simulate the rig", loaded.error()));
  Mesh mesh = misplaced(std::move(loaded->mesh), rig.simulation->pose_error, seed);
  if (rig.simulation->obstacle) {
    Mesh ball = make_sphere(rig.simulation->obstacle_radius, 1);
    ball.vertices.colwise() += *rig.simulation->obstacle;
    mesh = together(mesh, ball);
  }
  RenderOptions options;
  options.seed = seed;
  return std::make_shared<World>(rig, std::move(mesh), std::move(*truth), clock, seed, options);
}

Result<Devices> open_devices(const Rig& rig, std::shared_ptr<World> world) {
  if (rig.camera.model.width != world->rig().camera.model.width ||
      rig.camera.model.height != world->rig().camera.model.height) {
    return fail(ErrorCode::invalid_input,
                fmt::format("the simulated laboratory was made for another rig: \"{}\" instead of "
                            "\"{}\"; make a new one",
                            world->rig().name, rig.name));
  }
  Devices devices;
  devices.camera = make_camera(world);
  devices.gantry = make_gantry(world);
  devices.lamp = make_lamp(std::move(world));
  return devices;
}

}  // namespace lightrig::sim
