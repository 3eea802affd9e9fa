#pragma once

#include <filesystem>

#include "core/mesh.h"
#include "core/result.h"

namespace lightrig {

/// The triangles of a PLY, OBJ or STL file as they stand in it: unscaled, unrepaired, all its parts
/// together; normals only where the file gives them per vertex. Errors: not_found, refused,
/// invalid_input (unknown kind, truncated, no triangles), with the path and the reason.
Result<Mesh> read_mesh_file(const std::filesystem::path& file);

}  // namespace lightrig
