#include "config/load_object.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
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
  const auto say = [&](int n, const char* one, const char* many) {
    if (n > 0) parts.push_back(fmt::format("{} {}", n, n == 1 ? one : many));
  };
  say(r.non_finite_vertices, "vertex that was no number dropped",
      "vertices that were not numbers dropped");
  say(r.duplicate_vertices, "duplicate vertex merged", "duplicate vertices merged");
  say(r.degenerate_triangles, "triangle without area dropped", "triangles without area dropped");
  say(r.duplicate_triangles, "duplicate triangle dropped", "duplicate triangles dropped");
  say(r.unused_vertices, "unused vertex dropped", "unused vertices dropped");
  say(r.rewound_triangles, "triangle wound against its neighbours reversed",
      "triangles wound against their neighbours reversed");
  if (r.flipped_orientation) parts.emplace_back("was inside-out: turned");
  if (r.computed_normals) parts.emplace_back("normals computed");
  say(r.turned_normals, "normal turned outwards", "normals turned outwards");
  say(r.non_manifold_edges, "edge with more than two triangles left",
      "edges with more than two triangles left");
  say(r.boundary_edges, "boundary edge left", "boundary edges left");
  if (r.components > 1) parts.push_back(fmt::format("{} components", r.components));
  return parts.empty() ? "nothing to repair" : fmt::format("{}", fmt::join(parts, ", "));
}

// Moves and turns a mesh, after scaling.
void place(Mesh& mesh, double scale, const Eigen::Isometry3d& world_from_object) {
  mesh.vertices = ((world_from_object.linear() * mesh.vertices) * scale).colwise() +
                  world_from_object.translation();
  mesh.normals = world_from_object.linear() * mesh.normals;
}

/// [m] No rig lights an object of this size: a unit is wrong, or a vertex is.
constexpr double absurd_size = 100;

/// Refuses a mesh of absurd extent, naming its outermost vertex; vertices that are no numbers do
/// not count. Before repair: beside a vertex at 10³⁰ every triangle is a needle without area.
Result<void> check_extent(const Mesh& mesh, double unit, const std::string& name) {
  std::array<std::vector<double>, 3> values;
  for (const auto& vertex : mesh.vertices.colwise())
    if (vertex.allFinite())
      for (std::size_t axis = 0; axis < 3; ++axis)
        values[axis].push_back(vertex[static_cast<Eigen::Index>(axis)]);
  if (values[0].empty()) return {};
  Eigen::Vector3d median, extent;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto [least, most] = std::ranges::minmax(values[axis]);
    extent[static_cast<Eigen::Index>(axis)] = most - least;
    const auto half = values[axis].begin() + static_cast<std::ptrdiff_t>(values[axis].size() / 2);
    std::nth_element(values[axis].begin(), half, values[axis].end());
    median[static_cast<Eigen::Index>(axis)] = *half;
  }
  if (!(extent.maxCoeff() * unit > absurd_size)) return {};
  Eigen::Vector3d far = median;
  for (const auto& vertex : mesh.vertices.colwise())
    if (vertex.allFinite() &&
        (vertex - median).cwiseAbs().maxCoeff() > (far - median).cwiseAbs().maxCoeff())
      far = vertex;
  return fail(ErrorCode::invalid_input,
              fmt::format("load the object '{}': it is {:.3g} m across; its outermost vertex is "
                          "({:.6g}, {:.6g}, {:.6g}) in mesh units. Give the mesh's unit as "
                          "[object] unit_m (0.001 for millimetres), or take that vertex out",
                          name, extent.maxCoeff() * unit, far.x(), far.y(), far.z()));
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
    if (auto fits = check_extent(raw, config.unit, name); !fits)
      return tl::unexpected(fits.error());
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
