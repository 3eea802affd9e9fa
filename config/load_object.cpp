#include "config/load_object.h"

#include <fmt/format.h>

#include <cmath>
#include <string>
#include <vector>

#include "config/mesh_file.h"
#include "core/mesh_repair.h"
#include "core/shapes.h"

namespace lightrig {
namespace {

// In its own proportions; the caller brings it to size.
std::optional<Mesh> make_shape(const std::string& shape, int fineness) {
  if (shape == "sphere") return make_sphere(1.0, fineness);
  if (shape == "plane") return make_plane(1.0, 1.0, fineness);
  if (shape == "cylinder") return make_cylinder(0.5, 1.0, fineness);
  if (shape == "torus") return make_torus(1.0, 0.4, fineness);
  if (shape == "teapot") return make_teapot(1.0, fineness);
  return std::nullopt;
}

Eigen::Vector3d extent_of(const Mesh& mesh) {
  return mesh.vertices.rowwise().maxCoeff() - mesh.vertices.rowwise().minCoeff();
}

std::string repairs_text(const MeshRepairs& r) {
  std::vector<std::string> parts;
  const auto say = [&](int n, const char* what) {
    if (n > 0) parts.push_back(fmt::format("{} {}", n, what));
  };
  say(r.non_finite_vertices, "vertices that were not numbers dropped");
  say(r.duplicate_vertices, "duplicate vertices merged");
  say(r.degenerate_triangles, "triangles without area dropped");
  say(r.duplicate_triangles, "duplicate triangles dropped");
  say(r.unused_vertices, "unused vertices dropped");
  say(r.rewound_triangles, "triangles wound against their neighbours reversed");
  if (r.flipped_orientation) parts.emplace_back("was inside-out: turned");
  if (r.computed_normals) parts.emplace_back("normals computed");
  say(r.turned_normals, "normals turned outwards");
  say(r.non_manifold_edges, "edges with more than two triangles left");
  say(r.boundary_edges, "boundary edges left");
  if (r.components > 1) parts.push_back(fmt::format("{} components", r.components));
  return parts.empty() ? "nothing to repair" : fmt::format("{}", fmt::join(parts, ", "));
}

// Moves and turns a mesh, after scaling.
void place(Mesh& mesh, double scale, const Eigen::Isometry3d& world_from_object) {
  mesh.vertices = ((world_from_object.linear() * mesh.vertices) * scale).colwise() +
                  world_from_object.translation();
  mesh.normals = world_from_object.linear() * mesh.normals;
}

}  // namespace

Result<LoadedObject> load_object(const ObjectConfig& config) {
  const bool built_in = config.mesh.empty();
  const std::string name = built_in ? "built-in " + config.shape : config.mesh.filename().string();
  Mesh raw;
  if (built_in) {
    auto shape = make_shape(config.shape, config.fineness);
    if (!shape)
      return fail(ErrorCode::invalid_input,
                  fmt::format("there is no built-in shape '{}': sphere, plane, cylinder, torus or "
                              "teapot; or name a mesh file",
                              config.shape));
    raw = std::move(*shape);
  } else {
    auto read = read_mesh_file(config.mesh);
    if (!read) return tl::unexpected(read.error());
    raw = std::move(*read);
  }
  RepairedMesh repair = repaired(raw);
  LoadedObject object{std::move(repair.mesh), repair.repairs, {}};
  if (object.mesh.triangles.cols() == 0)
    return fail(ErrorCode::invalid_input, fmt::format("load the object '{}': no usable triangle is "
                                                      "left: {}",
                                                      name, repairs_text(object.repairs)));
  const Eigen::Vector3d extent = extent_of(object.mesh);
  const double scale = built_in ? config.size / extent.maxCoeff() : config.unit;
  place(object.mesh, scale, config.world_from_object);
  if (!object.mesh.vertices.allFinite() || !(extent.maxCoeff() * scale > 0))
    return fail(ErrorCode::invalid_input,
                fmt::format("load the object '{}': an extent of {} mesh units times {} m is no "
                            "size",
                            name, extent.maxCoeff(), scale));
  const Eigen::Vector3d size = extent * scale * 1000;
  object.description = fmt::format("{}: {} vertices, {} triangles, {:.4g} × {:.4g} × {:.4g} mm; {}",
                                   name, object.mesh.vertices.cols(), object.mesh.triangles.cols(),
                                   size.x(), size.y(), size.z(), repairs_text(object.repairs));
  return object;
}

}  // namespace lightrig
